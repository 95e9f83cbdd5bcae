/* The ring of shm/ring/ring.py in C11, two processes answering each other: what this protocol costs on this machine at least.

   gcc -O2 -std=c11 -o pingpong pingpong.c && echo 0.5 | ./pingpong CORE CORE
   For each line "seconds" on the standard input: one line of JSON, the times of the round trips in ns. */
#define _GNU_SOURCE
#include <sched.h>
#include <stdalign.h>
#include <stdatomic.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

enum { DEPTH = 64, VALUES = 27, KEPT = 1 << 20, WARM_UP = 200, CPU_S = 120 };
#define BUSY (UINT64_C(1) << 59)
#define LAST (-1.0)

struct record { int64_t stamp; double payload[VALUES]; };
struct slot { alignas(64) _Atomic uint64_t sequence; struct record record; };
struct ring { alignas(64) _Atomic uint64_t head; struct slot slots[DEPTH]; };
struct end { struct ring *ring; uint64_t n; struct record record; }; /* n: last written, or last read */

struct end writes, reads; /* not static: every copy has to be made, somebody else might look */
static uint32_t times[KEPT];

static void publish(int64_t stamp)
{
    uint64_t n = ++writes.n;
    struct slot *slot = &writes.ring->slots[n % DEPTH], *ahead = &writes.ring->slots[(n + 1) % DEPTH];
    writes.record.stamp = stamp;
    atomic_thread_fence(memory_order_release);                                  /* behind the W1 made ahead */
    memcpy(&slot->record, &writes.record, sizeof slot->record);                 /* W2 */
    atomic_store_explicit(&slot->sequence, n, memory_order_release);            /* W3 */
    atomic_store_explicit(&writes.ring->head, n, memory_order_release);         /* W4 */
    atomic_store_explicit(&ahead->sequence, BUSY + n + 1, memory_order_relaxed); /* W1 of the next */
}

static int next(void)
{
    uint64_t n = reads.n + 1;
    struct slot *slot = &reads.ring->slots[n % DEPTH];
    if (atomic_load_explicit(&slot->sequence, memory_order_acquire) != n)       /* S1 */
        return 0;
    memcpy(&reads.record, &slot->record, sizeof reads.record);                  /* R2 */
    atomic_thread_fence(memory_order_acquire);
    if (atomic_load_explicit(&slot->sequence, memory_order_relaxed) != n)       /* R3 */
        return 0;
    reads.n = n;
    return 1;
}

static int64_t now_ns(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return now.tv_sec * INT64_C(1000000000) + now.tv_nsec;
}

static int by_size(const void *a, const void *b)
{
    uint32_t x = *(const uint32_t *)a, y = *(const uint32_t *)b;
    return (x > y) - (x < y);
}

static int ping(double seconds)
{
    int64_t begin, now, end = now_ns() + (int64_t)(seconds * 1e9);
    int count = 0;
    do {
        begin = now_ns();
        publish(begin);
        while (!next()) {}
        now = now_ns();
        times[count++] = now - begin < UINT32_MAX ? (uint32_t)(now - begin) : UINT32_MAX;
    } while (now < end && count < KEPT);
    writes.record.payload[0] = LAST;
    publish(now);
    while (!next()) {}
    writes.record.payload[0] = 0;
    uint32_t *counted = times + (count > WARM_UP ? WARM_UP : 0);
    count -= (int)(counted - times);
    qsort(counted, (size_t)count, sizeof *counted, by_size);
    printf("{\"trip\": {\"p50\": %u, \"p99\": %u, \"n\": %d}}\n", counted[count / 2], counted[count * 99LL / 100], count);
    return reads.record.stamp == now; /* the answer to our last one */
}

int main(int argc, char **argv)
{
    int go[2], child;
    double seconds;
    char line;
    cpu_set_t set;
    struct rlimit limit = { CPU_S, CPU_S }; /* nobody polls for ever, whoever died */
    struct ring *rings = mmap(NULL, 2 * sizeof *rings, PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
    if (argc != 3 || rings == MAP_FAILED || pipe(go) || setrlimit(RLIMIT_CPU, &limit) || (child = fork()) < 0)
        return 2;
    writes.ring = child ? rings : rings + 1;
    reads.ring = child ? rings + 1 : rings;
    CPU_ZERO(&set);
    CPU_SET(atoi(argv[child ? 1 : 2]), &set);
    if (close(go[child ? 0 : 1]) || sched_setaffinity(0, sizeof set, &set))
        return 2;
    setvbuf(stdout, NULL, _IOLBF, 0);
    while (!child && read(go[0], &line, 1) == 1)
        do {
            while (!next()) {}
            publish(reads.record.stamp);
        } while (reads.record.payload[0] != LAST);
    if (child)
        puts("{}"); /* here we are */
    while (child && scanf("%lf", &seconds) == 1)
        if (write(go[1], "\n", 1) != 1 || !ping(seconds))
            return 1;
    return 0;
}
