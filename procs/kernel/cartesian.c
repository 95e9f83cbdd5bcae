/* procs/arm/cartesian.py: each function is the method by_numpy_… of the same name, or its own. */
#include "frames.h"

enum { POSITION, VELOCITY, EFFORT, SETPOINT, SETPOINT_VELOCITY };

static void show_pose(const Cartesian *k, const double *local, double *local_out, double *out, double *reference) {
  product(k->base, local, reference);
  pose_of(local, local_out);
  pose_of(reference, out);
}

static int any(const double *values, int64_t n) {
  for (int64_t i = 0; i < n; i++)
    if (values[i] != 0.0) return 1;
  return 0;
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

static void transpose(const double *rows, int64_t r, int64_t m, double *out) {
  for (int64_t i = 0; i < r; i++)
    for (int64_t j = 0; j < m; j++) out[r * j + i] = rows[m * i + j];
}

/* The body Jacobian (6, m) of the coordinates that are independent. */
static void independent(const Cartesian *k, double *rows) {
  if (!k->has_free) transpose(k->body, k->n, 6, rows);
  for (int r = 0; r < 6 && k->has_free; r++)
    for (int64_t c = 0; c < k->m; c++) {
      double total = 0.0;
      for (int64_t j = 0; j < k->n; j++) total += k->free[k->m * j + c] * k->body[6 * j + r];
      rows[k->m * r + c] = total;
    }
}

static void wrench_of(const Cartesian *k, const double *effort, double *out) {
  double rows[6 * k->m], columns[6 * k->m], own[k->m], a[36 + k->m * k->m];
  int is_solved = 0;
  if (any(effort, k->n)) {
    independent(k, rows);
    for (int64_t c = 0; c < k->m; c++) {
      own[c] = k->has_free ? 0.0 : effort[c];
      for (int64_t j = 0; j < k->n && k->has_free; j++) own[c] += k->free[k->m * j + c] * effort[j];
    }
    if (k->m < 6) {
      transpose(rows, 6, k->m, columns);
      squared(columns, k->m, 6, k->damping, a);
      is_solved = solve(a, own, k->m);
      times(rows, 6, k->m, own, out);
    } else {
      times(rows, 6, k->m, own, out);
      squared(rows, 6, k->m, k->damping, a);
      is_solved = solve(a, out, 6);
    }
  }
  if (!is_solved) memset(out, 0, sizeof(double[6]));
}

int64_t Cartesian_show(const Cartesian *k, int64_t is_new, int64_t absolute) {
  double frames[k->n][12], tip[12], reference[12], body[6 * k->n], spatial[6 * k->n], v[6];
  const Links links = LINKS(k);
  if (is_new) {
    const double *velocity = k->readings + SETPOINT_VELOCITY * k->size;
    joint_frames(&links, k->readings + SETPOINT * k->size, frames);
    product(frames[k->n - 1], k->end, tip);
    show_pose(k, tip, k->local_setpoint, k->setpoint, reference);
    memset(k->setpoint_twist, 0, sizeof v);
    if (any(velocity, k->n)) {
      jacobians(&links, frames, tip, body, spatial);
      twist_of(body, velocity, k->n, v);
      turn_twist(reference, v, k->setpoint_twist);
    }
  }
  joint_frames(&links, k->readings + POSITION * k->size, frames);
  product(frames[k->n - 1], k->end, tip);
  jacobians(&links, frames, tip, k->body, k->spatial);
  memcpy(k->tip, tip, sizeof tip);
  for (int r = 0; r < 6; r++)
    for (int64_t i = 0; i < k->n; i++) {
      k->shown_body[k->columns * r + i] = k->body[6 * i + r];
      k->shown_spatial[k->columns * r + i] = k->spatial[6 * i + r];
    }
  show_pose(k, tip, k->local_measured, k->measured, reference);
  memcpy(k->reference_tip, reference, sizeof reference);
  twist_of(k->body, k->readings + VELOCITY * k->size, k->n, k->body_twist);
  turn_twist(reference, k->body_twist, k->twist);
  wrench_of(k, k->readings + EFFORT * k->size, v);
  if (absolute) turn_twist(reference, v, k->body_wrench);
  else memcpy(k->body_wrench, v, sizeof v);
  double *w = k->spatial_wrench;
  turn_twist(tip, v, w);
  w[3] = w[3] + tip[7] * w[2] - tip[11] * w[1];
  w[4] = w[4] + tip[11] * w[0] - tip[3] * w[2];
  w[5] = w[5] + tip[3] * w[1] - tip[7] * w[0];
  return 0;
}

/* Of the joints, for the wanted twist of the measured tip. */
int64_t Cartesian_rates(const Cartesian *k) {
  double twist[6], rows[6 * k->m], columns[6 * k->m], found[k->m], a[k->m * k->m];
  turn_back(k->reference_tip, k->wanted_twist, twist);
  turn_back(k->reference_tip, k->wanted_twist + 3, twist + 3);
  independent(k, rows);
  if (k->m < 6) {
    transpose(rows, 6, k->m, columns);
    times(columns, k->m, 6, twist, found);
    squared(columns, k->m, 6, k->damping, a);
    if (!solve(a, found, k->m)) memset(found, 0, sizeof found);
  } else {
    shortest(rows, 6, k->m, twist, k->damping, found);
  }
  if (k->has_free) times(k->free, k->n, k->m, found, k->found_rates);
  else memcpy(k->found_rates, found, sizeof found);
  return 0;
}
