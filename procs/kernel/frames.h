/* Rigid frames, the upper three rows of a transform, and small systems of equations: procs/kinematics/frames.py. */
#pragma once
#include "fields.h"
#include <math.h>
#include <string.h>

typedef struct { int64_t n; const double *placements; const uint8_t *slides; } Links;
#define LINKS(k) ((Links){(k)->n, (k)->placements, (k)->slides})

#pragma GCC visibility push(hidden)  // else libc's times would be taken for ours
void joint_frames(const Links *c, const double *q, double (*frames)[12]);
void jacobians(const Links *c, double (*frames)[12], const double *tip, double *body, double *spatial);
void twist_between(const double *f, const double *g, double *out);
void pose_of(const double *f, double *out);
void times(const double *rows, int64_t r, int64_t m, const double *v, double *out);
int solve(double *a, double *x, int64_t n);
void squared(const double *rows, int64_t r, int64_t m, double damping, double *a);
void shortest(const double *rows, int64_t r, int64_t m, const double *wanted, double damping, double *x);
#pragma GCC visibility pop

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
