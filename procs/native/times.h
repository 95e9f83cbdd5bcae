/* The clocks of the system; the file that includes this first defines _GNU_SOURCE. */
#pragma once
#include <stdint.h>
#include <time.h>

static inline int64_t time_ns(clockid_t clock) {
  struct timespec now;
  clock_gettime(clock, &now);
  return now.tv_sec * 1000000000LL + now.tv_nsec;
}
