/* What responder.c and bare_client.c share: packets in hex, sockets on the loopback interface, and the core to run on. */
#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

enum { MOST_BYTES = 1024 };

struct packet {
    size_t size;
    unsigned char bytes[MOST_BYTES];
};

static inline void fail(const char *text)
{
    fprintf(stderr, "%s\n", text);
    exit(2);
}

static inline struct packet from_hex(const char *text)
{
    struct packet packet = {strlen(text) / 2, {0}};
    if (packet.size > MOST_BYTES)
        fail("packet too large");
    for (size_t i = 0; i < packet.size; i++) {
        unsigned int byte;
        if (sscanf(text + 2 * i, "%2x", &byte) != 1)
            fail("not hex");
        packet.bytes[i] = (unsigned char)byte;
    }
    return packet;
}

static inline size_t packet_size(const unsigned char *packet) /* bytes 1 to 4, little-endian */
{
    return packet[1] | (size_t)packet[2] << 8 | (size_t)packet[3] << 16 | (size_t)packet[4] << 24;
}

static inline int send_all(int peer, const unsigned char *bytes, size_t size)
{
    while (size > 0) {
        ssize_t sent = send(peer, bytes, size, 0);
        if (sent <= 0)
            return 0;
        bytes += sent;
        size -= (size_t)sent;
    }
    return 1;
}

static inline struct sockaddr_in loopback(int port)
{
    struct sockaddr_in place = {.sin_family = AF_INET, .sin_port = htons((unsigned short)port)};
    place.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    return place;
}

static inline void without_delay(int peer)
{
    int on = 1;
    setsockopt(peer, IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
}

static inline void use_core(int core)
{
#ifdef __linux__
    cpu_set_t set;
    CPU_ZERO(&set);
    if (core >= 0) {
        CPU_SET(core, &set);
        sched_setaffinity(0, sizeof set, &set);
    }
#else
    (void)core;
#endif
}
