/* Rigid frames, the upper three rows of a transform, and small systems of equations: procs/kinematics/frames.py. */
#pragma once
#include "fields.h"
#include <math.h>
#include <string.h>

typedef struct { int64_t n; const double *placements; const uint8_t *slides; } Links;
#define LINKS(k) ((Links){(k)->n, (k)->placements, (k)->slides})

static const double SAME_TURN = 1e-12, SMALL_TURN = 1e-8;

static inline void product(const double *f, const double *g, double *out) {
  for (int r = 0; r < 12; r += 4)
    for (int c = 0; c < 4; c++) {
      out[r + c] = f[r] * g[c] + f[r + 1] * g[4 + c] + f[r + 2] * g[8 + c];
      if (c == 3) out[r + c] += f[r + 3];
    }
}

static inline void cross(const double *a, const double *b, double *out) {
  out[0] = a[1] * b[2] - a[2] * b[1];
  out[1] = a[2] * b[0] - a[0] * b[2];
  out[2] = a[0] * b[1] - a[1] * b[0];
}

/* A vector of the frame that f is seen from, in axes of f. */
static inline void turn_back(const double *f, const double *v, double *out) {
  for (int c = 0; c < 3; c++) out[c] = f[c] * v[0] + f[4 + c] * v[1] + f[8 + c] * v[2];
}

static inline double dot(const double *a, const double *b, int64_t n) {
  double total = 0.0;
  for (int64_t i = 0; i < n; i++) total += a[i] * b[i];
  return total;
}

/* Of joints, once each has moved. */
static inline void joint_frames(const Links *c, const double *q, double (*frames)[12]) {
  for (int64_t i = 0; i < c->n; i++) {
    if (i) product(frames[i - 1], c->placements + 12 * i, frames[i]);
    else memcpy(frames[i], c->placements, sizeof(double[12]));
    double *f = frames[i];
    if (c->slides[i]) {
      for (int r = 0; r < 12; r += 4) f[r + 3] += f[r + 2] * q[i];
    } else {
      double cosine = cos(q[i]), sine = sin(q[i]);
      for (int r = 0; r < 12; r += 4) {
        double a = f[r], b = f[r + 1];
        f[r] = a * cosine + b * sine;
        f[r + 1] = b * cosine - a * sine;
      }
    }
  }
}

/* Columns (n, 6) of both. */
static inline void body_jacobian(const Links *c, double (*frames)[12], const double *tip, double *body) {
  for (int64_t i = 0; i < c->n; i++, body += 6) {
    const double *f = frames[i], z[3] = {f[2], f[6], f[10]};
    if (c->slides[i]) {
      turn_back(tip, z, body);
      memset(body + 3, 0, sizeof(double[3]));
      continue;
    }
    double away[3] = {tip[3] - f[3], tip[7] - f[7], tip[11] - f[11]}, v[3];
    cross(z, away, v);
    turn_back(tip, v, body);
    turn_back(tip, z, body + 3);
  }
}

static inline void spatial_jacobian(const Links *c, double (*frames)[12], double *spatial) {
  for (int64_t i = 0; i < c->n; i++, spatial += 6) {
    const double *f = frames[i], z[3] = {f[2], f[6], f[10]}, o[3] = {f[3], f[7], f[11]};
    if (c->slides[i]) {
      memcpy(spatial, z, sizeof z);
      memset(spatial + 3, 0, sizeof(double[3]));
      continue;
    }
    cross(o, z, spatial);
    memcpy(spatial + 3, z, sizeof z);
  }
}

/* The places (p, 3) of points of a body in the frames of its joints. */
static inline void points_at(int64_t p, const int64_t *of, const double *place, double (*frames)[12],
                             double (*points)[3]) {
  for (int64_t i = 0; i < p; i++)
    for (int r = 0; r < 3; r++) {
      const double *at = place + 3 * i, *f = of[i] < 0 ? 0 : frames[of[i]] + 4 * r;
      points[i][r] = f ? f[0] * at[0] + f[1] * at[1] + f[2] * at[2] + f[3] : at[r];
    }
}

static inline void quaternion_of(double a, double b, double c, double d, double e, double f, double g, double h, double i,
                          double *out) {
  double x, y, z, w, trace = a + e + i;
  if (trace >= a && trace >= e && trace >= i) {
    x = h - f, y = c - g, z = d - b, w = 1.0 + trace;
  } else if (a >= e && a >= i) {
    x = 1.0 + a - e - i, y = b + d, z = c + g, w = h - f;
  } else if (e >= i) {
    x = b + d, y = 1.0 - a + e - i, z = f + h, w = c - g;
  } else {
    x = c + g, y = f + h, z = 1.0 - a - e + i, w = d - b;
  }
  double length = copysign(sqrt(x * x + y * y + z * z + w * w), w);
  out[0] = x / length, out[1] = y / length, out[2] = z / length, out[3] = w / length;
}

static inline void pose_of(const double *f, double *out) {
  for (int r = 0; r < 3; r++) out[r] = f[4 * r + 3];
  quaternion_of(f[0], f[1], f[2], f[4], f[5], f[6], f[8], f[9], f[10], out + 3);
}

static inline void twist_between(const double *f, const double *g, double *out) {
  double away[3] = {g[3] - f[3], g[7] - f[7], g[11] - f[11]}, p[3], r[9], turn[4], bent[3];
  turn_back(f, away, p);
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) r[3 * i + j] = f[i] * g[j] + f[4 + i] * g[4 + j] + f[8 + i] * g[8 + j];
  quaternion_of(r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], turn);
  double x = turn[0], y = turn[1], z = turn[2], sine = sqrt(x * x + y * y + z * z);
  double factor = sine < SAME_TURN ? 2.0 : 2.0 * atan2(sine, turn[3]) / sine, *v = out + 3;
  for (int i = 0; i < 3; i++) v[i] = turn[i] * factor;
  double square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2], along = v[0] * p[0] + v[1] * p[1] + v[2] * p[2];
  double bend = square < SMALL_TURN ? 1.0 / 12.0 + square / 720.0 : (1.0 - 0.5 * factor * turn[3]) / square;
  cross(v, p, bent);
  for (int i = 0; i < 3; i++) out[i] = p[i] - 0.5 * bent[i] + bend * (v[i] * along - square * p[i]);
}

static inline void times(const double *rows, int64_t r, int64_t m, const double *v, double *out) {
  for (int64_t i = 0; i < r; i++) out[i] = dot(rows + m * i, v, m);
}

static inline void swap(double *a, double *b) {
  double kept = *a;
  *a = *b, *b = kept;
}

static inline int solve(double *a, double *x, int64_t n) {
  for (int64_t k = 0; k < n; k++) {
    int64_t best = k;
    for (int64_t i = k + 1; i < n; i++)
      if (fabs(a[n * i + k]) > fabs(a[n * best + k])) best = i;
    for (int64_t j = k; j < n && best != k; j++) swap(a + n * k + j, a + n * best + j);
    swap(x + k, x + best);
    double pivot = a[n * k + k];
    if (pivot == 0.0) return 0;
    for (int64_t i = k + 1; i < n; i++) {
      double factor = a[n * i + k] / pivot;
      for (int64_t j = k + 1; j < n; j++) a[n * i + j] -= factor * a[n * k + j];
      x[i] -= factor * x[k];
    }
  }
  for (int64_t k = n - 1; k >= 0; k--) {
    for (int64_t j = k + 1; j < n; j++) x[k] -= a[n * k + j] * x[j];
    x[k] /= a[n * k + k];
  }
  return 1;
}

static inline void squared(const double *rows, int64_t r, int64_t m, double damping, double *a) {
  for (int64_t i = 0; i < r; i++)
    for (int64_t j = 0; j < r; j++) a[r * i + j] = dot(rows + m * i, rows + m * j, m) + (i == j ? damping : 0.0);
}

static inline void transpose(const double *rows, int64_t r, int64_t m, double *out) {
  for (int64_t i = 0; i < r * m; i++) out[r * (i % m) + i / m] = rows[i];
}

static inline void shortest(const double *rows, int64_t r, int64_t m, const double *wanted, double damping, double *x) {
  double a[r * r + m * m], y[r], columns[m * r];
  int is_solved;
  transpose(rows, r, m, columns);
  if (r <= m) {
    memcpy(y, wanted, sizeof y);
    squared(rows, r, m, damping, a);
    is_solved = solve(a, y, r);
    times(columns, m, r, y, x);
  } else {
    times(columns, m, r, wanted, x);
    squared(columns, m, r, damping, a);
    is_solved = solve(a, x, m);
  }
  for (int64_t k = 0; k < m && !is_solved; k++) x[k] = NAN;
}

/* Rows `chosen` of the body Jacobian, columns (n, 6), as (r, m): of the coordinates that are independent. */
static inline void independent(const double *body, int64_t n, const int64_t *chosen, int64_t r, const double *free,
                               int64_t m, double *rows) {
  for (int64_t i = 0; i < r * m; i++) {
    rows[i] = 0.0;
    for (int64_t j = 0; j < n; j++) rows[i] += free[m * j + i % m] * body[6 * j + chosen[i / m]];
  }
}
