/* Setpoints of the arms, from their rings: procs/io/setpoint_tracker.py for whoever goes on as before. Who does not is
   left as it was, and its bit is returned. */
#include "fields.h"
#include "numeric.h"
#include "rings.h"

enum { STAMP, MODE, HAS_VELOCITY, COUNT, IN_EFFORT, BIAS, PID, POSITION, VELOCITY, FEED_FORWARD, DESIRED };
enum { DRIVE = 1, ROOM = 8 };

/* The newest record into the private copy; its stamp, -1: there is none, or it has to be looked at. */
static int64_t newest(const Track *k, int64_t f, uint8_t *record) {
  int64_t stamp;
  if (!read_newest(k->head[f], k->slots[f], k->depth[f], k->stride[f], k->size[f], k->seen + f, record)) return -1;
  memcpy(&stamp, record + k->offsets[STAMP], sizeof stamp);
  return stamp < 0 ? -1 : stamp;
}

static uint32_t word_at(const uint8_t *record, int64_t offset) {
  uint32_t word;
  memcpy(&word, record + offset, sizeof word);
  return word;
}

/* Whether all of it has been done: a setpoint like the one before, or none where none was. */
static int take(const Track *k, int64_t f, const uint8_t *record) {
  int64_t robot = k->robot[f], count = k->axes[f], at = k->first[f];
  const int64_t *o = k->offsets;
  static const uint8_t zeros[ROOM];
  if (k->holding[robot] || k->applies_effort[f] || count > ROOM) return 0;
  int meant = word_at(record, o[BIAS]) == k->bias_generation[robot]
              && word_at(record, o[PID]) == k->pid_generation[robot];
  if (record[o[MODE]] != DRIVE || !meant || record[o[COUNT]] != count) return k->resting[f] && !k->follows_velocity[f];
  int velocity = record[o[HAS_VELOCITY]] && k->uses_velocity[robot];
  if (k->own[f] || velocity != k->follows_velocity[f] || memcmp(record + o[IN_EFFORT], zeros, count)) return 0;
  k->resting[f] = 0;
  memcpy(k->incoming + at, record + o[POSITION], sizeof(double) * count);
  if (velocity) memcpy(k->incoming + k->n + at, record + o[VELOCITY], sizeof(double) * count);
  memcpy(k->incoming + 3 * k->n + at, record + o[FEED_FORWARD], sizeof(double) * count);
  *k->dirty = 1;
  return 1;
}

/* Whether everything was a number, and has been handed on. */
static int apply(const Track *k) {
  for (int64_t i = 0; i < 4 * k->n; i++)
    if (!isfinite(k->incoming[i])) return 0;
  int any_late = 0;
  for (int64_t i = 0; i < k->n; i++) {
    double wanted = least_of(most_of(k->incoming[i], k->low[i]), k->high[i]), step = wanted - k->setpoint[i];
    int late = fabs(step) > k->most_step[i];
    k->at_limit[i] = wanted != k->incoming[i];
    k->setpoint[i] = late ? k->setpoint[i] + copysign(k->most_step[i], step) : wanted;
    k->feed[i] = k->incoming[k->n + i];
    any_late |= late;
  }
  *k->dirty = any_late;
  return 1;
}

/* Bits of robots that Python has to look at; then one more: some of what came must still be applied; and one where states
   are desired that io has not taken, or not carried out. */
int64_t Track_track(const Track *k, int64_t now_ns) {
  int64_t left = 0, desired = 0;
  for (int64_t f = 0; f < k->followers; f++) {
    int64_t robot = k->robot[f];
    uint8_t *record = (uint8_t *)k->copy[f];
    int64_t stamp = newest(k, f, record), age = now_ns - stamp;
    if (stamp <= 0) {
      left |= 1LL << f;
      desired = 1;
      continue;
    }
    int fresh = -k->timeout_ns <= age && age <= k->timeout_ns;
    uint32_t generation = word_at(record, k->offsets[DESIRED]);
    desired |= fresh && (k->desired_open[robot] || (generation && generation != k->desired_taken[robot]));
    int same = fresh && stamp == k->taken_ns[f] && !k->resting[f];
    if (k->enabled[robot] && !same && !(fresh && take(k, f, record))) {
      left |= 1LL << f;
      continue;
    }
    k->age_ns[robot] = age > 0 ? age : 0;
    k->is_fresh[f] = fresh;
    if (k->enabled[robot]) k->fresh_ns[f] = k->taken_ns[f] = stamp;
  }
  if (*k->dirty && (left || !apply(k))) left |= 1LL << k->followers;
  return left | desired << (k->followers + 1);
}
