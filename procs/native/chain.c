/* procs/kinematics/forward.py and gravity.py: each function is the method by_numpy_… of the same name. */
#include "frames.h"

int64_t Chain_update(const Chain *k) {
  double frames[k->n][12], tip[12];
  joint_frames(&LINKS(k), k->q, frames);
  product(frames[k->n - 1], k->end, tip);
  body_jacobian(&LINKS(k), frames, tip, k->body);
  spatial_jacobian(&LINKS(k), frames, k->spatial);
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

/* From the last link on, what the mass after each joint does to it. */
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
