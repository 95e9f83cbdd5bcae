/* peek: print a live ring of Trocar from C, by the layout of docs/shared-memory.md. Linux, nothing but libc:
       cc -std=c11 -O2 -Wall -Wextra -pedantic -Werror -o peek tools/peek.c       (glibc before 2.34: and -lrt)
       ./peek SYSTEM INSTANCE TOPIC [FIELD...] [--count N] [--follow]     or: ./peek /trocar~SYSTEM~INSTANCE~TOPIC ...
   Prints the newest record, or the N newest that are kept; with --follow the newest and all that come, until N are
   printed or the segment is removed; on stderr, how many were lost (overwritten before they were read). A line:
   sequence stamp_ns field=value...; arrays flat in [], text in "" with \xNN, ? as 0 or 1, <f2 as its bits. Exit code 1:
   no such ring or field, a bad ring, an empty one; 2: used wrongly. Not checked: fingerprint, info JSON.
   Memory order: acquire loads of head and sequence; the copy in relaxed 64-bit loads, as memcpy would be a race in C;
   an acquire fence before the sequence is looked at again. Plain moves on x86-64, barriers where they are needed. */
#define _DEFAULT_SOURCE
#include <fcntl.h>
#include <inttypes.h>
#include <pwd.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <unistd.h>
#define BUSY (UINT64_C(1) << 59)
#define pages(size) (((size) + 4095) / 4096 * 4096)
#define load(at, order) atomic_load_explicit(at, memory_order_##order)
#define need(good, ...) do { if (!(good)) { fprintf(stderr, "peek: %s: ", segment ? segment : "used wrongly"); \
                        fprintf(stderr, __VA_ARGS__); fputc('\n', stderr); exit(segment ? 1 : 2); } } while (0)
enum { HEAD = 192 / 8, TEXT_AT = 256, LIMIT = 1 << 20, DEPTH = 1 << 16, RETRIES = 16, FIELDS = 1024, BLOCK = 512 };
static struct { char magic[8]; uint32_t version, first; uint64_t fingerprint; uint32_t stride, depth, schema, info;
                char kind[16]; uint64_t size; } h;
_Static_assert(sizeof h == 64 && ATOMIC_LLONG_LOCK_FREE == 2 && __BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "machine");
static struct field { const char *name; size_t offset, size, count; int type, array, asked; } fields[FIELDS];
static char text[LIMIT + 1], built[256], *segment;
static struct stat file;
static _Atomic uint64_t *words;
static uint64_t copy[LIMIT / 8], next, lost, known, record = 16; /* known fields; bytes: sequence, stamp_ns, ... */

static void lay(struct field *f, char *d) { /* (6,8,)<f8 is 48 doubles, aligned like one; S20 is 20 bytes anywhere */
    static const char allowed[][4] = {"?", "u1", "i1", "<u2", "<u4", "<u8", "<i2", "<i4", "<i8", "<f2", "<f4", "<f8"};
    size_t i = 0;
    for (d += f->array = *d == '('; f->array && *d != ')'; d += *d == ',') {
        size_t n = *d >= '0' && *d <= '9' ? strtoul(d, &d, 10) : LIMIT + 1;
        need(n <= LIMIT && (f->count *= n) <= LIMIT, "field %s: its shape is out of range", f->name);
    }
    for (d += f->array; i < 12 && strcmp(d, allowed[i]);) i++;
    f->type = d[*d == '<'];
    f->size = *d == '?' ? 1 : strtoul(d + 1 + (*d == '<'), &d, 10);
    need(i < 12 || (f->type == 'S' && f->size && f->size < 10000 && !*d), "field %s: what dtype is this?", f->name);
    f->offset = f->type == 'S' ? record : (record + f->size - 1) / f->size * f->size;
    record = f->offset + f->size * f->count;
}

static int attach(char **names) { /* everything is checked against the file before anything is mapped */
    int fd = shm_open(segment, O_RDONLY | O_NONBLOCK, 0); /* never waits, whatever lies there */
    need(fd >= 0, "there is no such segment, or it is not for us to read; is the system up?");
    struct passwd *service = getenv("TROCAR_SERVICE_USER") ? getpwnam(getenv("TROCAR_SERVICE_USER")) : NULL;
    need(!fstat(fd, &file) && (!file.st_uid || file.st_uid == getuid() || (service && file.st_uid == service->pw_uid)),
         "belongs to a user who is not accepted");
    need(pread(fd, &h, sizeof h, 0) == sizeof h, "is too short for a header");
    need(!memcmp(h.magic, "TROCAR\0\1", 8), "is not a Trocar segment");
    need(h.version == 2, "has header version %" PRIu32 ", this program reads 2", h.version);
    need(!memcmp(h.kind, "ring\0\0\0\0\0\0\0\0\0\0\0", 16), "is not a ring");
    need(h.stride && h.stride <= LIMIT && h.stride % 64 == 0 && h.depth && h.depth <= DEPTH,
         "stride %" PRIu32 " or depth %" PRIu32 " is out of range", h.stride, h.depth);
    need(h.schema <= LIMIT && h.info <= LIMIT && h.first == pages(TEXT_AT + h.schema + h.info), "its texts do not fit");
    need(h.size == (uint64_t)file.st_size && h.size == pages(h.first + (uint64_t)h.stride * h.depth) &&
         h.size <= (uint64_t)file.st_blocks * BLOCK, "its file is not as long as the header says, or has holes");
    need(pread(fd, text, h.schema, TEXT_AT) == (ssize_t)h.schema && strlen(text) == h.schema && h.schema > 3 &&
         !strcmp(text + h.schema - 3, "}]}"), "its schema is not whole");
    for (char *p = text; (p = strstr(p, "{\"name\":\"")); p++) { /* in a text its quotes would have a \ before them */
        char *name = p + 9, *q = strchr(name, '"'); /* from q on: ","dtype":"..." */
        need(known < FIELDS && q && !strncmp(q, "\",\"dtype\":\"", 11) && (p = strchr(q + 11, '"')), "strange schema");
        *q = *p = 0;
        fields[known] = (struct field){.name = name, .count = 1, .asked = !*names};
        for (char **a = names; *a; a++) if (!strcmp(*a, name)) fields[known].asked = 1, *a = "";
        lay(&fields[known++], q + 11);
    }
    need((record + 63) / 64 * 64 == h.stride, "schema and stride contradict each other");
    for (; *names; names++) need(!**names, "there is no field %s", *names);
    need((words = mmap(NULL, h.size, PROT_READ, MAP_SHARED, fd, 0)) != MAP_FAILED, "cannot be mapped");
    return fd;
}

static int take(void) { /* 1: record `next` is copied; 0: it is not out yet, or was not to be had whole */
    for (int i = 0; i < RETRIES; i++) {
        _Atomic uint64_t *slot = words + (h.first + next % h.depth * h.stride) / 8;
        uint64_t seen = load(slot, acquire); /* S1 */
        if (seen == BUSY + next) return 0;
        for (size_t k = 0; seen == next && k < (record + 7) / 8; k++) copy[k] = load(slot + k, relaxed); /* R2 */
        atomic_thread_fence(memory_order_acquire);
        if (seen == next && load(slot, relaxed) == next) return ++next, 1; /* R3 */
        uint64_t head = load(words + HEAD, acquire), step = head - next + 2 - h.depth; /* to the oldest that is kept */
        need(next <= head + 2, "the head went backwards");
        if (next > head) return 0;
        if (head - next < h.depth - 1) step = load(slot, acquire) != next;
        next += step, lost += step;
    }
    return 0;
}

static void print_value(int type, size_t n, const char *at) {
    union { uint64_t bits; float single; double real; } v = {0};
    memcpy(&v, at, n < 8 ? n : 8);
    if (type == 'i') printf("%" PRId64, (int64_t)(v.bits << (64 - 8 * n)) >> (64 - 8 * n));
    else if (type == 'f' && n > 2) printf("%.*g", n == 8 ? 17 : 9, n == 8 ? v.real : (double)v.single);
    else if (type != 'S') printf("%" PRIu64, v.bits);
    else {
        for (putchar('"'); n && *at; n--, at++)
            printf(*at & 0xe0 && *at != 127 && *at != '"' && *at != '\\' ? "%c" : "\\x%02x", (unsigned char)*at);
        putchar('"');
    }
}

static void print_record(void) {
    printf("%" PRIu64 " %" PRId64, copy[0], (int64_t)copy[1]);
    for (struct field *f = fields; f < fields + known; f++) {
        if (!f->asked) continue;
        printf(f->array ? " %s=[" : " %s=", f->name);
        for (size_t i = 0; i < f->count; i++, fputs(i < f->count ? "," : "", stdout))
            print_value(f->type, f->size, (const char *)copy + f->offset + i * f->size);
        if (f->array) putchar(']');
    }
    putchar('\n');
}

int main(int argc, char **argv) {
    int follow = 0, n = 0, got = 0;
    uint64_t count = 0, told = 0;
    for (int i = 1; i < argc; i++)
        if (!strcmp(argv[i], "--follow")) follow = 1;
        else if (strcmp(argv[i], "--count")) argv[n++] = argv[i];
        else need(++i < argc && (count = strtoull(argv[i], NULL, 10)), "--count takes a number from 1 on");
    char **names = argv + (n && *argv[0] == '/' ? 1 : 3);
    need(n >= names - argv, "peek SYSTEM INSTANCE TOPIC [FIELD...] [--count N] [--follow]");
    argv[n] = NULL;
    if (*argv[0] != '/') snprintf(built, sizeof built, "/trocar~%s~%s~%s", argv[0], argv[1], argv[2]);
    segment = *argv[0] == '/' ? argv[0] : built;
    int fd = attach(names);
    uint64_t head = load(words + HEAD, acquire), kept = head < h.depth ? head : h.depth - 1;
    need(head < BUSY && (head || follow), "its head is %" PRIu64 ": nothing to read", head);
    next = head + 1 - (!count || follow ? kept > 0 : count < kept ? count : kept);
    for (count = count ? count : follow ? UINT64_MAX : 1; count && (follow || next <= head);) {
        int gone = !fstat(fd, &file) && !file.st_nlink;
        if ((got = take())) count--, print_record();
        if (follow && lost > told && !(got && count)) fprintf(stderr, "peek: %" PRIu64 " lost\n", told = lost);
        if (!got && (gone || !follow)) break;
        if (!got && !fflush(stdout)) usleep(1000);
    }
    need(follow || got, "no whole record was to be had");
    need(!fflush(stdout), "cannot print");
}
