/* Clocks of processes under test that jump: CLOCK_BOOTTIME as after a suspend, CLOCK_REALTIME as after a step, also in the
   kernel's stamps of datagrams and in waits by it that have begun. Preloaded; the offsets, two int64 of nanoseconds, are in
   the file that SHIFTED_CLOCKS names. The machine's clocks stay as they are. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

static const volatile int64_t none[2], *offsets = none;
static int (*true_time)(clockid_t, struct timespec *);
static ssize_t (*true_recvmsg)(int, struct msghdr *, int);
static int (*true_wait)(pthread_cond_t *, pthread_mutex_t *, const struct timespec *);

__attribute__((constructor)) static void begin(void) {
  const char *name = getenv("SHIFTED_CLOCKS");
  int file = name ? open(name, O_RDONLY | O_CLOEXEC) : -1;
  void *found = file < 0 ? MAP_FAILED : mmap(NULL, sizeof none, PROT_READ, MAP_SHARED, file, 0);
  if (file >= 0) close(file);
  if (found != MAP_FAILED) offsets = found;
}

static void shift(struct timespec *at, int64_t offset) {
  int64_t ns = at->tv_sec * 1000000000LL + at->tv_nsec + offset;
  at->tv_sec = ns / 1000000000LL, at->tv_nsec = ns % 1000000000LL;
}

int clock_gettime(clockid_t clock, struct timespec *at) {
  if (!true_time) true_time = dlsym(RTLD_NEXT, "clock_gettime");
  int failed = true_time(clock, at);
  int64_t offset = clock == CLOCK_BOOTTIME ? offsets[0] : clock == CLOCK_REALTIME ? offsets[1] : 0;
  if (!failed && offset) shift(at, offset);
  return failed;
}

ssize_t recvmsg(int file, struct msghdr *message, int flags) {
  if (!true_recvmsg) true_recvmsg = dlsym(RTLD_NEXT, "recvmsg");
  ssize_t size = true_recvmsg(file, message, flags);
  for (struct cmsghdr *one = size < 0 ? NULL : CMSG_FIRSTHDR(message); one; one = CMSG_NXTHDR(message, one))
    if (one->cmsg_level == SOL_SOCKET && one->cmsg_type == SO_TIMESTAMPNS) {
      struct timespec at;
      memcpy(&at, CMSG_DATA(one), sizeof at);
      shift(&at, offsets[1]);
      memcpy(CMSG_DATA(one), &at, sizeof at);
    }
  return size;
}

int pthread_cond_timedwait(pthread_cond_t *condition, pthread_mutex_t *mutex, const struct timespec *until) {
  if (!true_wait) /* the unversioned symbol is an old one with another kind of condition */
    true_wait = dlvsym(RTLD_NEXT, "pthread_cond_timedwait", "GLIBC_2.3.2");
  for (;;) {
    struct timespec end = *until, now;
    shift(&end, -offsets[1]);
    int result = true_wait(condition, mutex, &end);
    clock_gettime(CLOCK_REALTIME, &now);
    if (result != ETIMEDOUT || now.tv_sec > until->tv_sec ||
        (now.tv_sec == until->tv_sec && now.tv_nsec >= until->tv_nsec))
      return result;
  }
}
