/* procs/arm/governor.py: each function is the method of the same name. */
#include "fields.h"
#include "numeric.h"

/* How far a setpoint is behind, in seconds at the largest speed; what is not a number is infinitely far. */
static double seconds(double distance, double speed) {
  double behind = fabs(distance) / speed;
  return behind == behind ? behind : INFINITY;
}

int64_t Governor_advance(const Governor *k, double dt, int64_t has_feed) {
  int64_t moves = 0;
  *k->most = 0.0;
  for (int64_t i = 0; i < k->n; i++) {
    double speed = k->speed[i], rate = k->rate[i], gain = k->acceleration[i] * dt;
    double distance = k->target[i] - k->goal[i];
    int is_finite = isfinite(distance);
    if (!is_finite) distance = 0.0;
    double direct = distance / dt;
    double low = most_of(least_of(rate, 0.0) - gain, -speed), high = least_of(most_of(rate, 0.0) + gain, speed);
    double braking = (sqrt(0.25 + 2.0 * fabs(distance) / (gain * dt)) - 0.5) * gain;
    double wanted = least_of(most_of(copysign(braking, distance), low), high);
    int is_direct = low <= direct && direct <= high;
    double velocity = is_direct ? direct : wanted, slower = copysign(most_of(fabs(rate) - 0.25 * gain, 0.0), rate);
    k->rate[i] = velocity * rate < 0.0 || fabs(velocity) >= fabs(slower) ? velocity : slower;
    k->goal[i] = is_direct && is_finite ? k->target[i] : k->goal[i] + velocity * dt;
    k->behind[i] = seconds(k->target[i] - k->goal[i], speed);
    *k->most = most_of(*k->most, k->behind[i]);
    if (has_feed) k->velocity[i] = least_of(most_of(k->feed[i], -speed), speed);
    moves |= !is_direct || k->rate[i] != 0.0;
  }
  return moves;
}

int64_t Governor_measure(const Governor *k) {
  int64_t worst = 0, inside = 1;
  for (int64_t i = 0; i < k->n; i++) {
    k->behind[i] = seconds(k->asked[i] - k->goal[i], k->speed[i]);
    if (k->behind[i] > k->behind[worst]) worst = i;
    inside &= k->lower[i] <= k->asked[i] && k->asked[i] <= k->upper[i];
  }
  *k->most = k->behind[worst];
  return inside ? worst : ~worst;
}
