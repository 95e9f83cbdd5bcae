/* A loop's deadlines as procs/node/pacing.py has them, and the wait for the next one. */
#define _GNU_SOURCE
#include "fields.h"
#include "times.h"
#include <errno.h>
#include <linux/futex.h>
#include <sys/syscall.h>
#include <unistd.h>

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
  int64_t deadline = Pace_end_of_work(k, time_ns(CLOCK_MONOTONIC), periods), until = deadline - spin_ns, now;
  struct timespec wake = {.tv_sec = until / 1000000000, .tv_nsec = until % 1000000000};
  if (time_ns(CLOCK_MONOTONIC) < until) while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &wake, 0) == EINTR) {}
  while ((now = time_ns(CLOCK_MONOTONIC)) < deadline && spin_ns) {}
  return Pace_begin_work(k, now) ? -now : now;
}

/* As Pace_wait, but a process with news for us sets the wake-up word to 0, and so begins the next cycle
   (shm/time/wakeup.py). The caller has set it to 1, and to 0 again if there was news. A signal ends the sleep, too. */
int64_t Pace_sleep(const Pace *k, int64_t periods) {
  int64_t *words = k->words, deadline = Pace_end_of_work(k, time_ns(CLOCK_MONOTONIC), periods), left, now;
  while (__atomic_load_n(k->wakeup, __ATOMIC_SEQ_CST) == 1 && (left = deadline - time_ns(CLOCK_MONOTONIC)) > 0) {
    struct timespec most = {.tv_sec = left / 1000000000, .tv_nsec = left % 1000000000};
    if (syscall(SYS_futex, k->wakeup, FUTEX_WAIT, 1, &most, NULL, 0) && errno == EINTR) break;
  }
  __atomic_store_n(k->wakeup, 0, __ATOMIC_SEQ_CST);
  int64_t soonest = words[WORD_START] + k->quickest_ns;
  if (soonest > deadline) soonest = deadline;
  struct timespec begin = {.tv_sec = soonest / 1000000000, .tv_nsec = soonest % 1000000000};
  if (time_ns(CLOCK_MONOTONIC) < soonest) while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &begin, 0) == EINTR) {}
  if ((now = time_ns(CLOCK_MONOTONIC)) < deadline)
    words[WORD_DEADLINE] -= (deadline - now + k->period_ns - 1) / k->period_ns * k->period_ns;
  return Pace_begin_work(k, now) ? -now : now;
}
