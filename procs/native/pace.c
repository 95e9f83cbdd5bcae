/* A loop's deadlines as procs/node/pacing.py has them, and the wait for the next one. */
#define _GNU_SOURCE
#include "fields.h"
#include <errno.h>
#include <time.h>

static int64_t monotonic_ns(void) {
  struct timespec now;
  clock_gettime(CLOCK_MONOTONIC, &now);
  return now.tv_sec * 1000000000LL + now.tv_nsec;
}

/* Others read the cells of the control page meanwhile. */
static void show(uint64_t *cell, int64_t value) { __atomic_store_n(cell, (uint64_t)value, __ATOMIC_RELAXED); }

static int64_t pulled(const Pace *k, int64_t deadline) {
  int64_t step = k->words[WORD_STEP], error = (k->words[WORD_WANTED] - deadline) % step;
  if (error < 0) error += step;
  if (error > step / 2) error -= step;
  return deadline + (int64_t)((double)error * k->gain);
}

int64_t Pace_end_of_work(const Pace *k, int64_t now_ns, int64_t periods) {
  int64_t *words = k->words, work = now_ns - words[WORD_START], deadline = words[WORD_DEADLINE];
  if (words[WORD_WANTED]) deadline = pulled(k, deadline);
  words[WORD_WANTED] = 0;
  if (words[WORD_KEPT] < k->room) k->work[words[WORD_KEPT]] = (double)work;
  if (work > k->period_ns) show(k->overruns, ++words[WORD_OVERRUNS]);
  deadline += k->period_ns * periods;
  if (now_ns > deadline) {
    int64_t skipped = (now_ns - deadline) / k->period_ns + 1;
    show(k->missed, words[WORD_MISSED] += skipped);
    deadline += (skipped - 1) * k->period_ns;
  }
  return words[WORD_DEADLINE] = deadline;
}

/* 1: it is time to look. */
int64_t Pace_begin_work(const Pace *k, int64_t now_ns) {
  int64_t *words = k->words;
  if (words[WORD_KEPT] < k->room) k->periods[words[WORD_KEPT]++] = (double)(now_ns - words[WORD_START]);
  words[WORD_START] = now_ns;
  show(k->cycles, ++words[WORD_CYCLES]);
  __atomic_store_n(k->beat, now_ns, __ATOMIC_RELAXED);
  return now_ns >= words[WORD_LOOK];
}

/* End this cycle, sleep until the last `spin_ns` before the next deadline, begin; when that is, negative: time to look.
   What Python does about signals it does then. */
int64_t Pace_wait(const Pace *k, int64_t periods, int64_t spin_ns) {
  int64_t deadline = Pace_end_of_work(k, monotonic_ns(), periods), until = deadline - spin_ns, now;
  struct timespec wake = {.tv_sec = until / 1000000000, .tv_nsec = until % 1000000000};
  if (monotonic_ns() < until) while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &wake, 0) == EINTR) {}
  while ((now = monotonic_ns()) < deadline && spin_ns) {}
  return Pace_begin_work(k, now) ? -now : now;
}
