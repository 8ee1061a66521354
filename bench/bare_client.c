/* A minimal b-CAP client in C: the lower bound of a round trip in bench/natural.py.
 *
 * bare_client CORE PORT REQUEST
 *
 * REQUEST is a packet in hex. For each line "COUNT INTERVAL" of the standard input, the program makes COUNT round trips,
 * one every INTERVAL ns (0: back to back), and prints their durations in ns in one line. The duration includes what every
 * client must do: number the request, receive a whole reply, compare its serial number, and read eight doubles.
 */
#define _GNU_SOURCE
#include "common.h"

#include <stdint.h>
#include <time.h>

enum { SERIAL = 5, HEAD = 15, VALUES = 25, AXES = 8 };

static int peer;
static struct packet request;
static volatile double values[AXES];

static int64_t now(void)
{
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (int64_t)time.tv_sec * 1000000000 + time.tv_nsec;
}

static void wait_until(int64_t moment)
{
    int64_t left = moment - now();
    if (left > 0) {
        struct timespec time = {left / 1000000000, left % 1000000000};
        nanosleep(&time, NULL);
    }
}

static void exchange(uint16_t serial)
{
    unsigned char reply[MOST_BYTES];
    size_t have = 0;
    request.bytes[SERIAL] = (unsigned char)serial;
    request.bytes[SERIAL + 1] = (unsigned char)(serial >> 8);
    if (!send_all(peer, request.bytes, request.size))
        fail("bare_client: connection lost");
    while (have < HEAD || have < packet_size(reply)) {
        ssize_t got = recv(peer, reply + have, sizeof reply - have, 0);
        if (got <= 0)
            fail("bare_client: connection lost");
        have += (size_t)got;
    }
    if (memcmp(reply + SERIAL, request.bytes + SERIAL, 2) || have < VALUES + AXES * sizeof(double))
        fail("bare_client: unexpected reply");
    for (int i = 0; i < AXES; i++) {
        double value;
        memcpy(&value, reply + VALUES + i * sizeof value, sizeof value);
        values[i] = value;
    }
}

int main(int argc, char **argv)
{
    if (argc != 4)
        fail("usage: bare_client CORE PORT REQUEST");
    use_core(atoi(argv[1]));
    struct sockaddr_in place = loopback(atoi(argv[2]));
    request = from_hex(argv[3]);
    peer = socket(AF_INET, SOCK_STREAM, 0);
    if (peer < 0 || connect(peer, (struct sockaddr *)&place, sizeof place))
        fail("bare_client: no connection");
    without_delay(peer);
    long count;
    long long interval;
    uint16_t serial = 0;
    while (scanf("%ld %lld", &count, &interval) == 2) {
        int64_t due = now();
        int64_t *spent = calloc((size_t)count, sizeof *spent);
        if (!spent)
            fail("bare_client: no memory");
        for (long i = 0; i < count; i++) {
            wait_until(due);
            due += interval;
            int64_t begin = now();
            exchange(++serial ? serial : ++serial);
            spent[i] = now() - begin;
        }
        for (long i = 0; i < count; i++)
            printf("%lld ", (long long)spent[i]);
        printf("\n");
        fflush(stdout);
        free(spent);
    }
    return 0;
}
