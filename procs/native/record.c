/* procs/arm/readings.py, record.py and effort_limits.py: each function is the method by_numpy_… of the same name. */
#include "frames.h"

/* Rows times a matrix (m, n): x · A. */
static void mapped(const double *x, const double *map, int64_t m, int64_t n, double *out) {
  for (int64_t j = 0; j < n; j++) {
    out[j] = 0.0;
    for (int64_t i = 0; i < m; i++) out[j] += x[i] * map[n * i + j];
  }
}

static int take(const double *from, double *to, int64_t n) {
  if (!memcmp(to, from, sizeof(double) * n)) return 0;
  memcpy(to, from, sizeof(double) * n);
  return 1;
}

int64_t Readings_update(const Readings *k, int64_t now_ns, int64_t stamp_ns) {
  const double *given[] = {k->position, k->velocity, k->effort, k->setpoint, k->setpoint_velocity, k->setpoint_effort};
  int64_t age = now_ns > stamp_ns ? now_ns - stamp_ns : stamp_ns - now_ns, found = *k->fault ? FAULTY : 0, news = 0;
  int has_sample = *k->biased && 0 <= *k->age_ns && *k->age_ns <= k->late_ns;
  if (stamp_ns > 0 && age <= k->late_ns) found |= FRESH;
  if (*k->powered && *k->amps_on) found |= POWER;
  if (found & FRESH && *k->powered && has_sample) found |= VALID;
  for (int r = 0; r < 6; r++) news |= take(given[r], k->read + k->axes * r, k->axes);
  if (!news) return found;
  for (int r = 0; r < 6; r++) {
    const double *read = k->read + k->axes * r;
    double *row = k->rows + k->size * r;
    if (r % 3 == 2) mapped(read, k->to_actuator, k->axes, k->size, row);
    else times(k->to_joint, k->size, k->axes, read, row);
  }
  return found | CHANGED;
}

int64_t Setpoint_show(const Setpoint *k, int64_t in_effort) {
  double fed[k->size];
  for (int64_t i = 0; i < k->size; i++) {
    fed[i] = k->gravity[i] + k->feed[i];
    if (in_effort && k->pushed[i]) k->goal[i] = k->measured[i];
  }
  mapped(fed, k->to_joint, k->size, k->axes, k->feed_forward);
  times(k->to_actuator, k->axes, k->size, k->goal, k->position);
  times(k->to_actuator, k->axes, k->size, k->goal + k->size, k->velocity);
  if (!in_effort) return 0;
  mapped(k->wanted, k->to_joint, k->size, k->axes, k->effort);
  for (int64_t a = 0; a < k->axes; a++) {
    k->in_effort[a] = 1;
    for (int64_t i = 0; i < k->size; i++)
      if (k->to_actuator[k->size * a + i] != 0.0 && !k->pushed[i]) k->in_effort[a] = 0;
  }
  return 0;
}

/* 1: no joint and no motor has more than it bears. */
int64_t Limits_bear(const Limits *k) {
  double of_motors[k->axes];
  int bears = 1;
  mapped(k->wanted, k->to_joint, k->size, k->axes, of_motors);
  for (int64_t i = 0; i < k->size; i++) bears &= (k->of_joints[i] = fabs(k->wanted[i]) / k->rated[i]) <= 1.0;
  for (int64_t a = 0; a < k->axes; a++) bears &= (k->of_motors[a] = fabs(of_motors[a]) / k->motors[a]) <= 1.0;
  return bears;
}
