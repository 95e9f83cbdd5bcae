/* master: be the master of a teleoperation from C, where the libraries of most haptic devices are. An example to take
   from; it says a slow circle, and a gripper that is opened and closed once (which shows presence). Nothing but libc:
       cc -std=c11 -O2 -Wall -Wextra -pedantic -Werror -o master tools/master.c -lm      (glibc before 2.34: and -lrt)
       ./master SYSTEM ARM [SECONDS]            ARM is of type MTM_GENERIC; until the system ends, or so long
   The contract is docs/third-party-masters.md, the ring docs/shared-memory.md. It answers no commands, and `trocar
   status` does not know of it. Exit code 1: there is no such place, or another program has it; 2: used wrongly. */
#define _DEFAULT_SOURCE
#include <fcntl.h>
#include <inttypes.h>
#include <math.h>
#include <stdatomic.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/file.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>
#define BUSY (UINT64_C(1) << 59)
#define need(good, ...) do { if (!(good)) { fprintf(stderr, "master: " __VA_ARGS__); fputc('\n', stderr); exit(1); } } \
                        while (0)
enum { TEXT_AT = 256, LIMIT = 1 << 20, PERIOD_NS = 5000000 };

/* The record; `input` is a byte for every button that a console asks for, in the order of `inputs` in the info text. */
struct record {
    uint64_t sequence; int64_t stamp_ns;
    char program[40], state[16], sub_state[40];
    bool is_homed, is_busy; uint8_t control_mode; bool simulated, reference_valid;
    char reference_frame[24];
    double measured_cp[7], setpoint_cp[7], measured_cv[6]; /* m, quaternion x y z w; m/s, rad/s */
    bool gripper_valid; double gripper_position; /* rad */
    bool has_jaw; double jaw_setpoint_position, setpoint_position[8];
    char tool[40];
    uint32_t stops; char stopped_by[48]; /* it answers no commands, so there are none */
    int64_t age_ns;
    bool input[];
};
static const char *layout[] = { /* the same as the schema says it, to be compared */
    "program S40", "state S16", "sub_state S40", "is_homed ?", "is_busy ?", "control_mode u1", "simulated ?",
    "reference_valid ?", "reference_frame S24", "measured_cp (7,)<f8", "setpoint_cp (7,)<f8", "measured_cv (6,)<f8",
    "gripper_valid ?", "gripper_position <f8", "has_jaw ?", "jaw_setpoint_position <f8", "setpoint_position (8,)<f8",
    "tool S40", "stops <u4", "stopped_by S48", "age_ns <i8"};
struct header {
    char magic[8]; uint32_t version, first; uint64_t fingerprint; uint32_t stride, depth, schema, info; char kind[16];
    uint64_t size; uint32_t pid, epoch; uint64_t start; char instance[64]; char unused[48]; _Atomic uint64_t head;
};
_Static_assert(sizeof(struct header) == 200 && ATOMIC_LLONG_LOCK_FREE == 2, "machine");

static struct header *header;
static char *base;
static uint64_t next; /* the record that comes */

static _Atomic uint64_t *slot(uint64_t n) {
    return (_Atomic uint64_t *)(void *)(base + header->first + n % header->depth * header->stride);
}

static void begin(void) { /* W1 */
    atomic_store_explicit(slot(next), BUSY + next, memory_order_relaxed);
    atomic_thread_fence(memory_order_release);
}

static void publish(const struct record *record) {
    const uint64_t *from = (const uint64_t *)(const void *)record;
    _Atomic uint64_t *to = slot(next);
    for (size_t k = 1; k < header->stride / 8; k++)
        atomic_store_explicit(to + k, from[k], memory_order_relaxed); /* W2 */
    atomic_store_explicit(to, next, memory_order_release); /* W3 */
    atomic_store_explicit(&header->head, next++, memory_order_release); /* W4 */
    begin();
}

static void check_schema(const char *text) {
    char row[96];
    for (size_t i = 0; i < sizeof layout / sizeof *layout; i++) {
        const char *blank = strchr(layout[i], ' ');
        int name = (int)(blank - layout[i]);
        snprintf(row, sizeof row, "{\"name\":\"%.*s\",\"dtype\":\"%s\"", name, layout[i], blank + 1);
        text = strstr(text, "{\"name\":");
        need(text && !strncmp(text, row, strlen(row)), "the place has another layout than this program: %s", layout[i]);
        text++;
    }
}

static uint64_t started(void) { /* field 22 of our stat; the name in brackets may have blanks */
    char line[1024] = "", *at;
    FILE *file = fopen("/proc/self/stat", "r");
    need(file && fgets(line, sizeof line, file) && (at = strrchr(line, ')')), "cannot read /proc/self/stat");
    fclose(file);
    for (int field = 2; field < 22; field++) at = strchr(at + 1, ' ');
    return strtoull(at, NULL, 10);
}

static int take_place(const char *system, const char *arm) { /* as a writer of Trocar does: claim, tell who, recover */
    static char text[LIMIT + 1];
    char name[256];
    struct header h;
    struct stat file;
    snprintf(name, sizeof name, "/trocar~%s~%s~state", system, arm);
    int fd = shm_open(name, O_RDWR | O_NONBLOCK, 0);
    need(fd >= 0, "there is no %s; is the system up?", name);
    need(!fstat(fd, &file) && (!file.st_uid || file.st_uid == getuid()), "%s belongs to somebody else", name);
    need(pread(fd, &h, sizeof h, 0) == sizeof h && !memcmp(h.magic, "TROCAR\0\1", 8) && h.version == 2 &&
         !strcmp(h.kind, "ring") && h.size == (uint64_t)file.st_size && h.schema <= LIMIT && h.stride <= LIMIT &&
         h.stride >= sizeof(struct record) && h.depth && h.first + (uint64_t)h.depth * h.stride <= h.size,
         "%s is no ring for this program", name);
    need(pread(fd, text, h.schema, TEXT_AT) == (ssize_t)h.schema && strstr(text, "\"writer\":\"third_party\""),
         "%s is not a place for your own program", arm);
    check_schema(text);
    need(!flock(fd, LOCK_EX | LOCK_NB), "another program is %s", arm);
    base = mmap(NULL, h.size, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    need(base != MAP_FAILED, "%s cannot be mapped", name);
    header = (struct header *)(void *)base;
    header->epoch++, header->pid = (uint32_t)getpid(), header->start = started();
    memset(header->instance, 0, sizeof header->instance);
    strncpy(header->instance, arm, sizeof header->instance - 1);
    uint64_t head = atomic_load(&header->head);
    if (atomic_load(slot(head + 1)) == head + 1) atomic_store(&header->head, ++head); /* V1 */
    next = head + 1;
    begin(); /* V2 */
    return fd;
}

static double seconds_of(const struct timespec *t) { return (double)t->tv_sec + 1e-9 * (double)t->tv_nsec; }

int main(int argc, char **argv) {
    if (argc < 3 || argc > 4) return fprintf(stderr, "master SYSTEM ARM [SECONDS]\n"), 2;
    int fd = take_place(argv[1], argv[2]);
    double length = argc > 3 ? atof(argv[3]) : INFINITY, t = 0.0;
    struct record *me = calloc(1, header->stride);
    struct timespec start, now, period = {.tv_nsec = PERIOD_NS};
    struct stat file;
    need(me && !clock_gettime(CLOCK_MONOTONIC, &start), "no memory, or no clock");
    strcpy(me->program, "master.c"), strcpy(me->state, "ENABLED"), strcpy(me->sub_state, "ENABLED");
    me->is_homed = me->simulated = me->reference_valid = me->gripper_valid = true, me->control_mode = 1;
    while (t < length && !fstat(fd, &file) && file.st_nlink) { /* without a name: the system has ended */
        clock_gettime(CLOCK_MONOTONIC, &now);
        t = seconds_of(&now) - seconds_of(&start);
        double angle = t < 2.0 ? 0.0 : 0.5 * (t - 2.0); /* here stands what your device says */
        double pose[7] = {0.04 * (cos(angle) - 1.0), 0.04 * sin(angle), 0.0, 0.0, 0.0, 0.0, 1.0};
        memcpy(me->measured_cp, pose, sizeof pose), memcpy(me->setpoint_cp, pose, sizeof pose);
        me->measured_cv[0] = t < 2.0 ? 0.0 : -0.02 * sin(angle), me->measured_cv[1] = t < 2.0 ? 0.0 : 0.02 * cos(angle);
        me->gripper_position = t < 2.0 ? 0.45 * (1.0 - cos(3.14159265 * t)) : 0.0;
        me->stamp_ns = (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
        publish(me);
        nanosleep(&period, NULL);
    }
    return 0;
}
