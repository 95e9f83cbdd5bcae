/* procs/kinematics/walls/moved.py: each function is the method by_numpy_… of the same name. */
#include "frames.h"

/* A frame at a place, with its z in a direction. */
static void frame_along(const double *place, const double *z, double *f) {
  double axis[3] = {0.0, 0.0, 0.0}, x[3], y[3];
  int least = 0;
  for (int i = 1; i < 3; i++)
    if (fabs(z[i]) < fabs(z[least])) least = i;
  axis[least] = 1.0;
  cross(z, axis, x);
  double length = sqrt(dot(x, x, 3));
  for (int i = 0; i < 3; i++) x[i] /= length;
  cross(z, x, y);
  for (int r = 0; r < 3; r++) f[4 * r] = x[r], f[4 * r + 1] = y[r], f[4 * r + 2] = z[r], f[4 * r + 3] = place[r];
}

/* Moves walls to where another arm is measured; returns 0, and leaves them, if that cannot be. */
int64_t MovedWalls_follow(const MovedWalls *k) {
  double q[k->n], frames[k->n][12], points[k->p][3], tip[12], back[12], to[12], f[12];
  const Links links = LINKS(k);
  for (int64_t i = 0; i < k->n; i++) {
    q[i] = dot(k->to_joint + k->axes * i, k->position, k->axes);
    if (!(k->least[i] <= q[i] && q[i] <= k->most[i])) return 0;
  }
  joint_frames(&links, q, frames);
  product(frames[k->n - 1], k->end, tip);
  memcpy(to, k->relation, sizeof to);
  if (k->by_tip[0]) {
    const double place[3] = {-tip[3], -tip[7], -tip[11]};
    double away[3];
    turn_back(tip, place, away);
    for (int r = 0; r < 3; r++) {
      for (int c = 0; c < 3; c++) back[4 * r + c] = tip[4 * c + r];
      back[4 * r + 3] = away[r];
    }
    product(k->relation, back, to);
  }
  if (k->hangs) {
    product(to, tip, f);
    product(f, k->pose, k->frames);
    return 1;
  }
  points_at(k->p, k->of, k->place, frames, points);
  for (int64_t i = 0; i < k->s; i++) {
    const double *start = points[k->starts[i]], *stop = points[k->stops[i]];
    double place[3], way[3], length = 0.0;
    for (int r = 0; r < 3; r++) {
      const double *t = to + 4 * r;
      place[r] = dot(t, start, 3) + t[3];
      way[r] = t[0] * (stop[0] - start[0]) + t[1] * (stop[1] - start[1]) + t[2] * (stop[2] - start[2]);
      length += way[r] * way[r];
    }
    k->size[3 * i + 1] = length = sqrt(length);
    for (int r = 0; r < 3; r++) way[r] = length > 0.0 ? way[r] / length : r == 2;
    frame_along(place, way, k->frames + 12 * i);
  }
  return 1;
}

/* `follow` for all of these structs; returns whether each is measured, at most `most_ns` before its io's record. */
int64_t MovedWalls_follow_all(const MovedWalls *k, int64_t addresses, int64_t count, int64_t most_ns) {
  const int64_t *each = (const int64_t *)addresses;
  (void)k;
  for (int64_t i = 0; i < count; i++) {
    const MovedWalls *m = (const MovedWalls *)each[i];
    if (!m->biased[0] || m->age_ns[0] < 0 || m->age_ns[0] > most_ns || !MovedWalls_follow(m)) return 0;
  }
  return 1;
}
