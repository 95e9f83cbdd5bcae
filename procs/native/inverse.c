/* procs/kinematics/inverse/solver.py: each function is the method by_numpy_… of the same name, or its own. */
#include "frames.h"
#include "numeric.h"

static const double PI = 3.141592653589793, FULL_TURN = 2.0 * 3.141592653589793;

/* The twist from the tip at q to the goal, and what coordinates do to its rows; weighed for the nearest. */
static void miss(const Inverse *k, const double *q, int is_weighed, double *error, double *rows) {
  double frames[k->n][12], tip[12], twist[6], body[6 * k->n];
  joint_frames(&LINKS(k), q, frames);
  product(frames[k->n - 1], k->end, tip);
  twist_between(tip, k->goal, twist);
  body_jacobian(&LINKS(k), frames, tip, body);
  for (int part = 0; part < 6 && is_weighed; part += 3) {
    double furthest = part ? k->furthest_turn : k->furthest_place, weight = part ? k->turn_weight : 1.0;
    double size = sqrt(dot(twist + part, twist + part, 3)), scale = (size > furthest ? furthest / size : 1.0) * weight;
    for (int i = part; i < part + 3; i++) {
      twist[i] *= scale;
      for (int64_t j = 0; j < k->n; j++) body[6 * j + i] *= weight;
    }
  }
  for (int64_t r = 0; r < k->rows_count; r++) error[r] = twist[k->rows[r]];
  independent(body, k->n, k->rows, k->rows_count, k->free, k->m, rows);
}

/* q := at, changed by that of the coordinates. */
static void spread(const Inverse *k, const double *at, const double *change, double *q) {
  for (int64_t i = 0; i < k->n; i++) q[i] = at[i] + dot(k->free + k->m * i, change, k->m);
}

static double largest(const double *change, int64_t m) {
  double longest = 0.0;
  for (int64_t i = 0; i < m; i++)
    if (!(fabs(change[i]) <= longest) && longest == longest) longest = fabs(change[i]);
  return longest;
}

static double step(const Inverse *k, const double *rows, const double *error, double *change) {
  double a[k->rows_count * k->m], longest = NAN;
  if (k->rows_count == k->m) {
    memcpy(a, rows, sizeof a);
    memcpy(change, error, sizeof(double) * k->m);
    if (solve(a, change, k->m)) longest = largest(change, k->m);
  }
  if (!(longest <= k->max_step)) {
    shortest(rows, k->rows_count, k->m, error, k->damping, change);
    longest = largest(change, k->m);
    if (longest > k->max_step)
      for (int64_t i = 0; i < k->m; i++) change[i] *= k->max_step / longest;
  }
  return longest;
}

/* Steps taken until q has its tip at the goal, -1 less those taken in vain. */
int64_t Inverse_newton(const Inverse *k, double furthest) {
  double error[k->rows_count], rows[k->rows_count * k->m], change[k->m], before = 2.0 * furthest, size = INFINITY;
  int64_t steps = 0;
  for (int64_t round = 0; round <= k->max_steps; round++) {
    miss(k, k->q, 0, error, rows);
    size = sqrt(dot(error, error, k->rows_count));
    if (size < k->converged || !(size <= k->slow * before)) break;
    before = size;
    double longest = step(k, rows, error, change);
    spread(k, k->q, change, k->q);
    steps++;
    if (longest < k->last_step && size < k->last_error) return steps;
  }
  return size < k->accepted ? steps : -1 - steps;
}

/* Which joint is beyond its limit by most; -1: none is by more than the room. */
int64_t Inverse_fits(const Inverse *k, double room) {
  double most = -INFINITY, *q = k->q;
  int64_t axis = 0, is_nan = 0;
  for (int64_t i = 0; i < k->n; i++) {
    double lower = k->lower[i], upper = k->upper[i], seed = k->seed[i];
    if (k->turns[i] && isfinite(q[i]) && !(fabs(q[i] - seed) <= PI && lower <= q[i] && q[i] <= upper)) {
      q[i] += FULL_TURN * rint((seed - q[i]) / FULL_TURN);
      if (q[i] > upper + room) q[i] -= FULL_TURN;
      else if (q[i] < lower - room) q[i] += FULL_TURN;
    }
    double over = lower - q[i] > q[i] - upper ? lower - q[i] : q[i] - upper;
    is_nan |= isnan(over);
    if (over > most) most = over, axis = i;
  }
  if (!is_nan && most <= room) {
    for (int64_t i = 0; i < k->n; i++) q[i] = least_of(most_of(q[i], k->lower[i]), k->upper[i]);
    return -1;
  }
  *k->beyond = most > room ? most : INFINITY;
  return axis;
}

static void bounded(const Inverse *k, const double *rows, const double *error, double *change) {
  int64_t m = k->m, r = k->rows_count, outside = 1;
  double rest[r], part[r * m], found[m];
  uint8_t left[m];
  memset(left, 1, sizeof left);
  for (int64_t round = 0; round < m && outside; round++) {
    memcpy(rest, error, sizeof rest);
    memcpy(part, rows, sizeof part);
    for (int64_t c = 0; c < m; c++)
      for (int64_t i = 0; i < r && !left[c]; i++) {
        rest[i] -= rows[m * i + c] * change[c];
        part[m * i + c] = 0.0;
      }
    shortest(part, r, m, rest, k->nearest_damping, found);
    outside = 0;
    for (int64_t j = 0; j < m; j++) {
      if (!left[j]) continue;
      double lower = fmin(k->lower[j] - k->seed[j], 0.0), upper = fmax(k->upper[j] - k->seed[j], 0.0), dx = found[j];
      change[j] = dx < lower ? lower : dx > upper ? upper : dx;
      if (change[j] != dx && !isnan(dx)) left[j] = 0, outside = 1;
    }
  }
}

/* One step from the seed towards the goal, within limits and `most`. */
int64_t Inverse_approach(const Inverse *k) {
  double error[k->rows_count], rows[k->rows_count * k->m], change[k->m], share = 1.0;
  miss(k, k->seed, 1, error, rows);
  bounded(k, rows, error, change);
  for (int64_t i = 0; i < k->m; i++)
    if (fabs(change[i]) / k->most[i] > share) share = fabs(change[i]) / k->most[i];
  for (int64_t i = 0; i < k->m; i++) change[i] /= share;
  spread(k, k->seed, change, k->q);
  if (!isfinite(dot(k->q, k->q, k->n))) memcpy(k->q, k->seed, sizeof(double) * k->n);
  return 0;
}
