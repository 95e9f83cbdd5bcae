/* Chains of an arm. Each function is the one of the same name in procs/kinematics, in the same order of operations. */
#include "frames.h"

/* Of joints, once each has moved. */
void joint_frames(const Links *c, const double *q, double (*frames)[12]) {
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
void jacobians(const Links *c, double (*frames)[12], const double *tip, double *body, double *spatial) {
  for (int64_t i = 0; i < c->n; i++, body += 6, spatial += 6) {
    const double *f = frames[i], z[3] = {f[2], f[6], f[10]}, o[3] = {f[3], f[7], f[11]};
    if (c->slides[i]) {
      turn_back(tip, z, body);
      memset(body + 3, 0, sizeof(double[3]));
      memcpy(spatial, z, sizeof z);
      memset(spatial + 3, 0, sizeof(double[3]));
      continue;
    }
    double away[3] = {tip[3] - o[0], tip[7] - o[1], tip[11] - o[2]}, v[3];
    cross(z, away, v);
    turn_back(tip, v, body);
    turn_back(tip, z, body + 3);
    cross(o, z, spatial);
    memcpy(spatial + 3, z, sizeof z);
  }
}

int64_t Chain_update(const Chain *k) {
  double frames[k->n][12], tip[12];
  joint_frames(&LINKS(k), k->q, frames);
  product(frames[k->n - 1], k->end, tip);
  jacobians(&LINKS(k), frames, tip, k->body, k->spatial);
  memcpy(k->tip, tip, sizeof tip);
  return 0;
}

/* After so many links, -1: the tip. */
int64_t Chain_frame(const Chain *k, int64_t link) {
  double frames[k->n][12];
  joint_frames(&LINKS(k), k->q, frames);
  if (link == 0) memcpy(k->frame, k->ends, sizeof(double[12]));
  else if (link < 0) product(frames[k->n - 1], k->end, k->frame);
  else product(frames[link - 1], k->ends + 12 * link, k->frame);
  return 0;
}

/* procs/kinematics/gravity.py: from the last link on, what the mass after each joint does to it. */
int64_t Gravity_hold(const Gravity *k) {
  double frames[k->n][12], q[k->n], torques[k->n], mass = 0.0, moment[3] = {0.0, 0.0, 0.0}, turned[3];
  times(k->follow, k->n, k->moved, k->q, q);
  joint_frames(&LINKS(k), q, frames);
  for (int64_t i = k->n - 1; i >= 0; i--) {
    const double *f = frames[i], *c = k->centres + 3 * i, z[3] = {f[2], f[6], f[10]};
    double away[3];
    mass += k->masses[i];
    for (int r = 0; r < 3; r++) {
      const double *row = f + 4 * r;
      moment[r] = moment[r] + k->masses[i] * (row[0] * c[0] + row[1] * c[1] + row[2] * c[2] + row[3]);
      away[r] = moment[r] - mass * row[3];
    }
    cross(z, away, turned);
    torques[i] = k->slides[i] ? mass * dot(k->up, z, 3) : dot(k->up, turned, 3);
  }
  times(k->bear, k->moved, k->n, torques, k->borne);
  return 0;
}
