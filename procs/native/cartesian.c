/* procs/arm/cartesian.py: each function is the method by_numpy_… of the same name, or its own. */
#include "frames.h"

static const int64_t ALL[6] = {0, 1, 2, 3, 4, 5};

enum { WRENCHES = 1, SPATIAL = 2 };
enum { POSITION, VELOCITY, EFFORT, SETPOINT, SETPOINT_VELOCITY };

static void show_pose(const Cartesian *k, const double *local, double *local_out, double *out, double *reference) {
  product(k->base, local, reference);
  pose_of(local, local_out);
  pose_of(reference, out);
}

/* The twist of the tip in its axes, for velocities of the joints. */
static void twist_of(const double *body, const double *velocity, int64_t n, double *out) {
  for (int r = 0; r < 6; r++) {
    out[r] = 0.0;
    for (int64_t i = 0; i < n; i++) out[r] += body[6 * i + r] * velocity[i];
  }
}

static void turn_twist(const double *f, const double *v, double *out) {
  for (int half = 0; half < 6; half += 3)
    for (int r = 0; r < 3; r++)
      out[half + r] = f[4 * r] * v[half] + f[4 * r + 1] * v[half + 1] + f[4 * r + 2] * v[half + 2];
}

/* The shortest x, zeros where there is none. */
static void any_shortest(const double *rows, int64_t r, int64_t m, const double *wanted, double damping, double *x) {
  shortest(rows, r, m, wanted, damping, x);
  if (!isfinite(dot(x, x, m))) memset(x, 0, sizeof(double) * m);
}

static void wrench_of(const Cartesian *k, const double *effort, double *out) {
  double rows[6 * k->m], columns[6 * k->m], own[k->m], free[k->m * k->n];
  independent(k->body, k->n, ALL, 6, k->free, k->m, rows);
  transpose(rows, 6, k->m, columns);
  transpose(k->free, k->n, k->m, free);
  times(free, k->m, k->n, effort, own);
  any_shortest(columns, k->m, 6, own, k->damping, out);
}

static void show_columns(const Cartesian *k, const double *columns, double *out) {
  for (int r = 0; r < 6; r++)
    for (int64_t i = 0; i < k->n; i++) out[k->columns * r + i] = columns[6 * i + r];
}

static void show_wrenches(const Cartesian *k, const double *tip, const double *reference, int64_t absolute) {
  double v[6], *w = k->spatial_wrench;
  wrench_of(k, k->readings + EFFORT * k->size, v);
  if (absolute) turn_twist(reference, v, k->body_wrench);
  else memcpy(k->body_wrench, v, sizeof v);
  turn_twist(tip, v, w);
  w[3] = w[3] + tip[7] * w[2] - tip[11] * w[1];
  w[4] = w[4] + tip[11] * w[0] - tip[3] * w[2];
  w[5] = w[5] + tip[3] * w[1] - tip[7] * w[0];
}

int64_t Cartesian_show(const Cartesian *k, int64_t is_new, int64_t absolute, int64_t wanted) {
  double frames[k->n][12], tip[12], reference[12], v[6], spatial[6 * k->n];
  const Links links = LINKS(k);
  if (is_new) {
    joint_frames(&links, k->readings + SETPOINT * k->size, frames);
    product(frames[k->n - 1], k->end, tip);
    show_pose(k, tip, k->local_setpoint, k->setpoint, reference);
    body_jacobian(&links, frames, tip, k->body);
    twist_of(k->body, k->readings + SETPOINT_VELOCITY * k->size, k->n, v);
    turn_twist(reference, v, k->setpoint_twist);
  }
  joint_frames(&links, k->readings + POSITION * k->size, frames);
  product(frames[k->n - 1], k->end, tip);
  body_jacobian(&links, frames, tip, k->body);
  memcpy(k->tip, tip, sizeof tip);
  show_columns(k, k->body, k->shown_body);
  if (wanted & SPATIAL) {
    spatial_jacobian(&links, frames, spatial);
    show_columns(k, spatial, k->shown_spatial);
  }
  show_pose(k, tip, k->local_measured, k->measured, reference);
  memcpy(k->reference_tip, reference, sizeof reference);
  twist_of(k->body, k->readings + VELOCITY * k->size, k->n, k->body_twist);
  turn_twist(reference, k->body_twist, k->twist);
  if (wanted & WRENCHES) show_wrenches(k, tip, reference, absolute);
  return 0;
}

/* Of the joints, for the wanted twist of the measured tip. */
int64_t Cartesian_rates(const Cartesian *k) {
  double twist[6], rows[6 * k->m], found[k->m];
  turn_back(k->reference_tip, k->wanted_twist, twist);
  turn_back(k->reference_tip, k->wanted_twist + 3, twist + 3);
  independent(k->body, k->n, ALL, 6, k->free, k->m, rows);
  any_shortest(rows, 6, k->m, twist, k->damping, found);
  times(k->free, k->n, k->m, found, k->found_rates);
  return 0;
}
