/* procs/arm/near.py: the function is the method by_numpy_… of the same name. */
#include "frames.h"

/* A pose, x y z and a quaternion, as a frame; 0: the quaternion is not nearly of length 1. */
static int frame_of(const double *pose, double slack, double *f) {
  const double *v = pose + 3;
  double length = sqrt(dot(v, v, 4));
  if (!(fabs(length - 1.0) <= slack)) return 0;
  double x = v[0] / length, y = v[1] / length, z = v[2] / length, w = v[3] / length;
  double xx = x * (x + x), yy = y * (y + y), zz = z * (z + z), xy = x * (y + y), xz = x * (z + z), yz = y * (z + z);
  double wx = w * (x + x), wy = w * (y + y), wz = w * (z + z);
  const double frame[12] = {1.0 - yy - zz, xy - wz, xz + wy, pose[0], xy + wz, 1.0 - xx - zz, yz - wx, pose[1],
                            xz - wy, yz + wx, 1.0 - xx - yy, pose[2]};
  memcpy(f, frame, sizeof frame);
  return 1;
}

/* 1: the joints for the pose are in q. */
int64_t Near_find(const Near *k, int64_t is_local) {
  const Inverse *inverse = (const Inverse *)k->inverse;
  double given[12];
  if (!frame_of(k->pose, k->slack, given)) return 0;
  if (is_local) memcpy(k->goal, given, sizeof given);
  else product(k->to_base, given, k->goal);
  memcpy(k->seed, k->at, sizeof(double) * k->n);
  memcpy(k->q, k->at, sizeof(double) * k->n);
  if (!isfinite(dot(k->goal, k->goal, 12) + dot(k->seed, k->seed, k->n))) return 0;
  if (Inverse_newton(inverse, k->close) < 0 || Inverse_fits(inverse, k->room) >= 0) return 0;
  for (int64_t i = 0; i < k->n; i++)
    if (!(fabs(k->q[i] - k->seed[i]) <= k->furthest_turn)) return 0;
  return 1;
}
