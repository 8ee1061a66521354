/* A minimal b-CAP responder: the peer of the round trips in bench/natural.py.
 *
 * responder CORE DEFAULT ID:REPLY ...
 *
 * The replies are whole packets in hex, one for each function ID; DEFAULT is the reply to every other function. Only the
 * serial number is copied from the request. Each connection has its own process, which blocks in recv(). The program
 * prints its port and ends if its standard input ends. CORE is the core to run on, -1 for any.
 */
#define _GNU_SOURCE
#include "common.h"

#include <poll.h>
#include <signal.h>

enum { HEAD = 15, FUNCTION = 9, SERIAL = 5, MOST_REPLIES = 32 };

static struct packet replies[MOST_REPLIES];
static int functions[MOST_REPLIES];
static int count;

static struct packet *reply_to(const unsigned char *request)
{
    int id = request[FUNCTION] | request[FUNCTION + 1] << 8;
    for (int i = 1; i < count; i++)
        if (functions[i] == id)
            return &replies[i];
    return &replies[0];
}

static void converse(int peer)
{
    static unsigned char buffer[65536];
    size_t have = 0;
    for (;;) {
        ssize_t got = recv(peer, buffer + have, sizeof buffer - have, 0);
        if (got <= 0)
            return;
        have += (size_t)got;
        while (have >= HEAD) {
            size_t size = packet_size(buffer);
            if (size < HEAD || size > sizeof buffer)
                return;
            if (have < size)
                break;
            struct packet *reply = reply_to(buffer);
            memcpy(reply->bytes + SERIAL, buffer + SERIAL, 2);
            if (!send_all(peer, reply->bytes, reply->size))
                return;
            have -= size;
            memmove(buffer, buffer + size, have);
        }
    }
}

int main(int argc, char **argv)
{
    if (argc < 3 || argc - 2 > MOST_REPLIES)
        fail("usage: responder CORE DEFAULT ID:REPLY ...");
    use_core(atoi(argv[1]));
    signal(SIGCHLD, SIG_IGN);
    signal(SIGPIPE, SIG_IGN);
    for (int i = 2; i < argc; i++, count++) {
        char *text = argv[i], *colon = strchr(text, ':');
        functions[count] = colon ? atoi(text) : -1;
        replies[count] = from_hex(colon ? colon + 1 : text);
    }
    int listener = socket(AF_INET, SOCK_STREAM, 0);
    struct sockaddr_in place = loopback(0);
    socklen_t size = sizeof place;
    if (listener < 0 || bind(listener, (struct sockaddr *)&place, sizeof place) || listen(listener, 512) ||
        getsockname(listener, (struct sockaddr *)&place, &size))
        fail("responder: no port");
    printf("%d\n", ntohs(place.sin_port));
    fflush(stdout);
    struct pollfd waiting[2] = {{listener, POLLIN, 0}, {0, POLLIN, 0}};
    while (poll(waiting, 2, -1) >= 0 && !waiting[1].revents) {
        if (!(waiting[0].revents & POLLIN))
            continue;
        int peer = accept(listener, NULL, NULL);
        if (peer < 0)
            continue;
        without_delay(peer);
        if (fork() == 0) {
            close(listener);
            converse(peer);
            _exit(0);
        }
        close(peer);
    }
    return 0;
}
