/* procs/kinematics/frames.py, function by function. */
#include "frames.h"

static void quaternion_of(double a, double b, double c, double d, double e, double f, double g, double h, double i,
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

void pose_of(const double *f, double *out) {
  for (int r = 0; r < 3; r++) out[r] = f[4 * r + 3];
  quaternion_of(f[0], f[1], f[2], f[4], f[5], f[6], f[8], f[9], f[10], out + 3);
}

void twist_between(const double *f, const double *g, double *out) {
  double away[3] = {g[3] - f[3], g[7] - f[7], g[11] - f[11]}, p[3], r[9], turn[4], bent[3];
  turn_back(f, away, p);
  for (int i = 0; i < 3; i++)
    for (int j = 0; j < 3; j++) r[3 * i + j] = f[i] * g[j] + f[4 + i] * g[4 + j] + f[8 + i] * g[8 + j];
  quaternion_of(r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8], turn);
  double x = turn[0], y = turn[1], z = turn[2], sine = sqrt(x * x + y * y + z * z);
  double factor = sine < 1e-12 ? 2.0 : 2.0 * atan2(sine, turn[3]) / sine, *v = out + 3;
  for (int i = 0; i < 3; i++) v[i] = turn[i] * factor;
  double square = v[0] * v[0] + v[1] * v[1] + v[2] * v[2], along = v[0] * p[0] + v[1] * p[1] + v[2] * p[2];
  double bend = square < 1e-8 ? 1.0 / 12.0 + square / 720.0 : (1.0 - 0.5 * factor * turn[3]) / square;
  cross(v, p, bent);
  for (int i = 0; i < 3; i++) out[i] = p[i] - 0.5 * bent[i] + bend * (v[i] * along - square * p[i]);
}

void times(const double *rows, int64_t r, int64_t m, const double *v, double *out) {
  for (int64_t i = 0; i < r; i++) out[i] = dot(rows + m * i, v, m);
}

int solve(double *a, double *x, int64_t n) {
  for (int64_t k = 0; k < n; k++) {
    int64_t best = k;
    for (int64_t i = k + 1; i < n; i++)
      if (fabs(a[n * i + k]) > fabs(a[n * best + k])) best = i;
    if (best != k) {
      for (int64_t j = 0; j < n; j++) {
        double kept = a[n * k + j];
        a[n * k + j] = a[n * best + j], a[n * best + j] = kept;
      }
      double kept = x[k];
      x[k] = x[best], x[best] = kept;
    }
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

void squared(const double *rows, int64_t r, int64_t m, double damping, double *a) {
  for (int64_t i = 0; i < r; i++)
    for (int64_t j = 0; j < r; j++) a[r * i + j] = dot(rows + m * i, rows + m * j, m) + (i == j ? damping : 0.0);
}

void shortest(const double *rows, int64_t r, int64_t m, const double *wanted, double damping, double *x) {
  double a[r * r], y[r];
  squared(rows, r, m, damping, a);
  memcpy(y, wanted, sizeof y);
  int is_solved = solve(a, y, r);
  for (int64_t k = 0; k < m; k++) {
    x[k] = is_solved ? 0.0 : NAN;
    for (int64_t i = 0; i < r && is_solved; i++) x[k] += rows[m * i + k] * y[i];
  }
}
