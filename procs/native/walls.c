/* procs/kinematics/walls/: each function is the method by_numpy_… of the same name, and shapes.py. */
#include "frames.h"
#include "numeric.h"

enum { PLANE, BOX, SPHERE, CYLINDER, CONE, CAPSULE };
static const double PARALLEL = 1e-12;

typedef struct { double value, along, normal[3]; } Nearest;

/* The distance of a point from an edge or face, given how far it is outside along two or three directions. */
static double outside(const double *beyond, int n, double *share) {
  double square = 0.0;
  int most = 0;
  for (int i = 0; i < n; i++) {
    if (beyond[i] > 0.0) square += beyond[i] * beyond[i];
    if (beyond[i] > beyond[most]) most = i;
    share[i] = 0.0;
  }
  if (square == 0.0) {
    share[most] = 1.0;
    return beyond[most];
  }
  double distance = sqrt(square);
  for (int i = 0; i < n; i++) share[i] = beyond[i] > 0.0 ? beyond[i] / distance : 0.0;
  return distance;
}

/* Signed distance from a shape in its own frame, and the direction in which it grows. */
static double distance_of(int64_t kind, const double *size, const double *p, double *g) {
  double radial = sqrt(p[0] * p[0] + p[1] * p[1]), beyond[3], share[3];
  double x = radial > 0.0 ? p[0] / radial : 1.0, y = radial > 0.0 ? p[1] / radial : 0.0;
  if (kind == BOX) {
    for (int i = 0; i < 3; i++) beyond[i] = fabs(p[i]) - size[i];
    double d = outside(beyond, 3, share);
    for (int i = 0; i < 3; i++) g[i] = copysign(share[i], p[i]);
    return d;
  }
  if (kind == CYLINDER) {
    beyond[0] = radial - size[0], beyond[1] = fabs(p[2]) - size[1];
    double d = outside(beyond, 2, share);
    g[0] = share[0] * x, g[1] = share[0] * y, g[2] = copysign(share[1], p[2]);
    return d;
  }
  if (kind == CONE) {
    double c = cos(size[0]), s = sin(size[0]), length = sqrt(radial * radial + p[2] * p[2]);
    if (p[2] * c + radial * s < 0.0) {
      g[0] = radial / length * x, g[1] = radial / length * y, g[2] = p[2] / length;
      return length;
    }
    g[0] = c * x, g[1] = c * y, g[2] = -s;
    return radial * c - p[2] * s;
  }
  if (kind == PLANE) {
    g[0] = g[1] = 0.0, g[2] = 1.0;
    return p[2];
  }
  double z = p[2] - (kind == CAPSULE ? most_of(least_of(p[2], size[1]), 0.0) : 0.0);
  double length = sqrt(radial * radial + z * z);
  if (length > 0.0) g[0] = radial / length * x, g[1] = radial / length * y, g[2] = z / length;
  else g[0] = 1.0, g[1] = g[2] = 0.0;
  return length - size[0];
}

/* How far along p + t · u (0 to 1) it is nearest to the piece of the z axis from 0 to `length`. */
static double along_axis(const double *p, const double *u, double length) {
  double a = dot(u, u, 3), b = u[2] * length, c = dot(u, p, 3), e = length * length, f = length * p[2];
  double apart = a * e - b * b, t = most_of(least_of(-c / a, 1.0), 0.0);
  if (e == 0.0) return t;
  if (apart > PARALLEL * a * e) t = most_of(least_of((b * f - c * e) / apart, 1.0), 0.0);
  double s = b * t + f;
  if (s < 0.0) return most_of(least_of(-c / a, 1.0), 0.0);
  return s > e ? most_of(least_of((b - c) / a, 1.0), 0.0) : t;
}

/* The least distance between a shape and a segment; that of a convex shape has one minimum along it. */
static void nearest(const Walls *k, int64_t w, const double *a, const double *b, Nearest *out) {
  const double *f = k->frames + 12 * w, *size = k->size + 3 * w;
  const double from[3] = {a[0] - f[3], a[1] - f[7], a[2] - f[11]}, way[3] = {b[0] - a[0], b[1] - a[1], b[2] - a[2]};
  double p[3], u[3], end[3], g[3], h[3], middle[3];
  turn_back(f, from, p);
  turn_back(f, way, u);
  for (int r = 0; r < 3; r++) end[r] = p[r] + u[r];
  if (k->kind[w] == CONE && dot(p, p, 3) < k->apex * k->apex) { /* a shaft through the apex: its end says where it goes */
    memcpy(p, end, sizeof p);
    memset(u, 0, sizeof u);
  }
  double first = distance_of(k->kind[w], size, p, g), last = distance_of(k->kind[w], size, end, h);
  if (k->keeps_in[w]) {
    out->along = last > first || (u[0] == 0.0 && u[1] == 0.0 && u[2] == 0.0);
    out->value = -most_of(first, last);
    for (int r = 0; r < 3; r++) g[r] = last > first ? -h[r] : -g[r];
  } else {
    double low = 0.0, high = 1.0;
    if ((k->kind[w] == SPHERE || k->kind[w] == CAPSULE) && dot(u, u, 3) > 0.0)
      low = high = along_axis(p, u, k->kind[w] == CAPSULE ? size[1] : 0.0);
    else if (dot(g, u, 3) >= 0.0) high = 0.0;
    else if (dot(h, u, 3) <= 0.0) low = 1.0;
    for (int64_t i = 0; i < k->halvings && low < high && high > 0.0 && low < 1.0; i++) {
      double half = 0.5 * (low + high);
      for (int r = 0; r < 3; r++) middle[r] = p[r] + half * u[r];
      distance_of(k->kind[w], size, middle, g);
      if (dot(g, u, 3) < 0.0) low = half;
      else high = half;
    }
    out->along = high == 0.0 ? 0.0 : low == 1.0 ? 1.0 : 0.5 * (low + high);
    for (int r = 0; r < 3; r++) middle[r] = p[r] + out->along * u[r];
    if (u[0] == 0.0 && u[1] == 0.0 && u[2] == 0.0) out->along = 1.0;
    out->value = distance_of(k->kind[w], size, middle, g);
  }
  for (int r = 0; r < 3; r++) out->normal[r] = f[4 * r] * g[0] + f[4 * r + 1] * g[1] + f[4 * r + 2] * g[2];
}

/* The distance from a wall, below 0 on its forbidden side, of every point within `radius` of a point: at least. */
static double at_least(const Walls *k, int64_t w, const double *point, double radius) {
  const double *f = k->frames + 12 * w, from[3] = {point[0] - f[3], point[1] - f[7], point[2] - f[11]};
  double p[3], g[3];
  turn_back(f, from, p);
  double distance = distance_of(k->kind[w], k->size + 3 * w, p, g);
  return (k->keeps_in[w] ? -distance : distance) - radius;
}

/* Distances of all pairs of a wall and a segment that it guards at joints q, INFINITY for others; the frames for them.
   Beyond `enough` they may be less than they are. */
static void look_at(const Walls *k, const double *q, double enough, double (*frames)[12], double (*points)[3],
                    Nearest *found) {
  const Links links = LINKS(k);
  double radius = 0.0;
  joint_frames(&links, q, frames);
  points_at(k->p, k->of, k->place, frames, points);
  for (int64_t i = 1; i < k->p; i++) {
    double away[3] = {points[i][0] - points[0][0], points[i][1] - points[0][1], points[i][2] - points[0][2]};
    radius = most_of(radius, dot(away, away, 3));
  }
  radius = sqrt(radius) + k->thickest;
  for (int64_t w = 0; w < k->w; w++) {
    double all = k->guards[w] ? at_least(k, w, points[0], radius + k->margin[w]) : INFINITY;
    for (int64_t s = 0; s < k->s; s++) {
      Nearest *pair = found + k->s * w + s;
      int is_guarded = (k->guards[w] & k->parts[s]) != 0;
      pair->value = is_guarded ? all : INFINITY;
      if (!is_guarded || all > enough) continue;
      nearest(k, w, points[k->starts[s]], points[k->stops[s]], pair);
      pair->value -= k->margin[w] + (k->kind[w] == CONE ? 0.0 : k->radius[s]);
    }
  }
}

/* How the distance of a pair grows with each joint (n). */
static void slope_of(const Walls *k, int64_t s, const Nearest *pair, double (*frames)[12], double (*points)[3],
                     double *slope) {
  const int64_t ends[2] = {k->starts[s], k->stops[s]};
  const double shares[2] = {1.0 - pair->along, pair->along};
  for (int64_t i = 0; i < k->n; i++) {
    const double *f = frames[i], z[3] = {f[2], f[6], f[10]};
    slope[i] = 0.0;
    for (int e = 0; e < 2; e++) {
      const double *point = points[ends[e]], away[3] = {point[0] - f[3], point[1] - f[7], point[2] - f[11]};
      double turned[3];
      if (i > k->of[ends[e]]) continue;
      cross(z, away, turned);
      slope[i] += shares[e] * dot(pair->normal, k->slides[i] ? z : turned, 3);
    }
  }
}

/* A segment that is inside another arm may be as near to any segment of it as to the nearest: `least` (w, s). */
static void grouped(const Walls *k, double *least) {
  int64_t end;
  for (int64_t w = 0; w < k->w; w = end) {
    for (end = w + 1; end < k->w && k->group[w] >= 0 && k->group[end] == k->group[w]; end++) {}
    if (k->group[w] < 0) continue;
    for (int64_t s = 0; s < k->s; s++) {
      double nearest = 0.0;
      for (int64_t i = w; i < end; i++) nearest = least_of(nearest, least[k->s * i + s]);
      for (int64_t i = w; nearest < 0.0 && i < end; i++) least[k->s * i + s] = least_of(least[k->s * i + s], nearest);
    }
  }
}

/* The first pair that comes nearer than `least` (w, s) on the straight way between joints, plus 1; 0: none. It is seen at
   `share` of the way; at `passed` of it there was none. `first`: what is found at its beginning, if that is known. `along`: see ArmWalls.ALONG. */
static int64_t blocked(const Walls *k, const double *from, const double *to, const double *least, double samples,
                       double along, const Nearest *first, double *share, double *passed) {
  double frames[k->n][12], points[k->p][3], q[k->n], way = 0.0, at = 0.0;
  Nearest found[k->w * k->s];
  for (int64_t i = 0; i < k->n; i++) way += fabs(to[i] - from[i]) * k->reach[i];
  double grain = most_of(k->grain, way / samples);
  *passed = 0.0;
  for (;;) {
    double room = INFINITY;
    for (int64_t i = 0; i < k->n; i++) q[i] = at < 1.0 ? from[i] + at * (to[i] - from[i]) : to[i];
    if (!first || at > 0.0) look_at(k, q, k->near, frames, points, found);
    for (int64_t i = 0; i < k->w * k->s; i++) {
      double spare = (first && at == 0.0 ? first : found)[i].value - least[i];
      double slack = least[i] < 0.0 && k->group[i / k->s] >= 0 ? along * way : 0.0;
      if (!(spare >= -(k->tiny + at * slack))) {
        *share = at;
        return i + 1;
      }
      room = least_of(room, spare);
    }
    *passed = at;
    if (at >= 1.0 || !(way > 0.0) || k->spare * (1.0 - at) * way <= room) return 0;
    at = least_of(1.0, at + most_of(room, grain) / way);
  }
}

/* Bounds a[i] · x >= b[i] (rows of m) for the x next to `wanted` in the metric h (m, m): Hildreth's method. */
static int64_t bounded(const Walls *k, int64_t count, const double *a, const double *b, const double *h,
                       const double *wanted, double *x) {
  int64_t m = k->m, strongest = 0;
  double moved[count + 1][m], square[count + 1], force[count + 1], copy[m * m];
  memcpy(x, wanted, sizeof(double) * m);
  for (int64_t i = 0; i < count; i++) {
    memcpy(copy, h, sizeof copy);
    memcpy(moved[i], a + m * i, sizeof moved[i]);
    square[i] = solve(copy, moved[i], m) ? dot(a + m * i, moved[i], m) : 0.0;
    force[i] = 0.0;
  }
  for (int64_t sweep = 0; sweep < k->sweeps; sweep++)
    for (int64_t i = 0; i < count; i++) {
      if (!(square[i] > k->flat)) continue;
      double change = most_of(-force[i], (b[i] - dot(a + m * i, x, m)) / square[i]);
      force[i] += change;
      for (int64_t j = 0; j < m; j++) x[j] += change * moved[i][j];
    }
  for (int64_t i = 1; i < count; i++)
    if (force[i] * sqrt(square[i]) > force[strongest] * sqrt(square[strongest])) strongest = i;
  return strongest;
}

static void tip_of(const Walls *k, double (*frames)[12], double *tip) { product(frames[k->n - 1], k->end, tip); }

/* The metric (m, m) of the tip's motion at joints with these frames, and the step (m,) that takes the tip to a goal. */
static void towards(const Walls *k, double (*frames)[12], const double *goal, const double *way, double *h, double *step) {
  int64_t n = k->n, m = k->m;
  double tip[12], body[6 * n], rows[6 * m], twist[6], copy[m * m];
  const Links links = LINKS(k);
  tip_of(k, frames, tip);
  const double away[3] = {goal[3] - tip[3], goal[7] - tip[7], goal[11] - tip[11]};
  twist_between(tip, goal, twist);
  turn_back(tip, away, twist);
  for (int r = 3; r < 6; r++) twist[r] *= k->turn;
  body_jacobian(&links, frames, tip, body);
  for (int64_t i = 0; i < 6 * m; i++) {
    rows[i] = 0.0;
    for (int64_t j = 0; j < n; j++) rows[i] += k->free[m * j + i % m] * body[6 * j + i / m];
    if (i / m >= 3) rows[i] *= k->turn;
  }
  for (int64_t i = 0; i < m; i++)
    for (int64_t j = 0; j < m; j++) {
      h[m * i + j] = i == j ? k->flat : 0.0;
      for (int r = 0; r < 6; r++) h[m * i + j] += rows[m * r + i] * rows[m * r + j];
    }
  times(k->gather, m, n, way, step);
  for (int64_t i = 0; i < m; i++) {
    step[i] *= k->flat;
    for (int r = 0; r < 6; r++) step[i] += rows[m * r + i] * twist[r];
  }
  memcpy(copy, h, sizeof copy);
  if (!solve(copy, step, m)) memset(step, 0, sizeof(double) * m);
}

/* How near each pair may come, `least` (w, s), from where it is `found`. */
static void allowed(const Walls *k, double share, int64_t is_step, const Nearest *found, double *least) {
  for (int64_t i = 0; i < k->w * k->s; i++) {
    double value = found[i].value;
    least[i] = value <= 0.0 ? value : is_step && value < k->near ? value * (1.0 - share * k->pace[i / k->s]) : 0.0;
  }
  grouped(k, least);
}

/* The first pair that comes nearer than it may, `least` (w, s), on the way to `goal`, plus 1; 0: none. */
static int64_t met(const Walls *k, double share, int64_t is_step, double *least, Nearest *found) {
  double frames[k->n][12], points[k->p][3], at;
  look_at(k, k->before, k->near, frames, points, found);
  allowed(k, share, is_step, found, least);
  return blocked(k, k->before, k->goal, least, 0.25 * k->samples, 0.0, found, k->share, &at);
}

/* Whether `keep` would change the step of a cycle. */
int64_t Walls_meets(const Walls *k, double share) {
  double least[k->w * k->s];
  Nearest found[k->w * k->s];
  return met(k, share, 1, least, found);
}

/* Put `goal` where the tip is nearest to it without a pair coming nearer than it may; the pair that stops it, plus 1. */
int64_t Walls_keep(const Walls *k, double share, int64_t is_step) {
  int64_t n = k->n, m = k->m, pairs = k->w * k->s, why;
  double frames[n][12], points[k->p][3], least[pairs], x[n], way[n], slope[n], u[m], wanted[m], h[m * m], at = 0.0;
  double goal_tip[12], low[n], high[n], scale = 1.0, samples = 0.25 * k->samples;
  double a[(pairs + 2 * n) * m], b[pairs + 2 * n];
  int64_t of[pairs + 2 * n];
  Nearest found[pairs];
  why = met(k, share, is_step, least, found);
  if (!why) return 0;
  for (int64_t i = 0; i < n; i++) {
    low[i] = least_of(k->lower[i], k->before[i]), high[i] = most_of(k->upper[i], k->before[i]);
    if (!is_step) continue;
    low[i] = most_of(low[i], k->before[i] + k->step[i]), high[i] = least_of(high[i], k->before[i] + k->step[n + i]);
  }
  look_at(k, k->goal, 0.0, frames, points, found);
  tip_of(k, frames, goal_tip);
  look_at(k, k->before, k->near, frames, points, found);
  memcpy(x, k->before, sizeof x);
  for (int64_t step = 0; step < k->steps; step++) {
    int64_t count = 0, strongest;
    double change = 0.0;
    for (int64_t i = 0; i < n; i++) way[i] = k->goal[i] - x[i];
    towards(k, frames, goal_tip, way, h, wanted);
    for (int64_t i = 0; i < pairs; i++) {
      if (!(found[i].value < k->near)) continue;
      slope_of(k, i % k->s, found + i, frames, points, slope);
      for (int64_t j = 0; j < m; j++) {
        a[m * count + j] = 0.0;
        for (int64_t r = 0; r < n; r++) a[m * count + j] += slope[r] * k->free[m * r + j];
      }
      b[count] = least[i] + (least[i] < 0.0 ? 0.0 : k->safe) - found[i].value, of[count++] = i;
    }
    for (int64_t i = 0; i < n; i++) {
      for (int sign = 1; sign >= -1; sign -= 2) {
        for (int64_t j = 0; j < m; j++) a[m * count + j] = sign * k->free[m * i + j];
        b[count] = sign > 0 ? low[i] - x[i] : x[i] - high[i], of[count++] = -1;
      }
    }
    strongest = bounded(k, count, a, b, h, wanted, u);
    if (of[strongest] >= 0) why = of[strongest] + 1;
    for (int64_t i = 0; i < n; i++) {
      double moved = dot(k->free + m * i, u, m);
      x[i] += moved;
      change = most_of(change, fabs(moved));
    }
    look_at(k, x, k->near, frames, points, found);
    if (change < k->small) break;
  }
  /* the sweeps do not always end within the bounds of the joints */
  for (int64_t i = 0; i < n; i++) {
    double moved = x[i] - k->before[i], most = moved > 0.0 ? high[i] - k->before[i] : low[i] - k->before[i];
    if (is_step && fabs(moved) > k->over * fabs(most)) scale = least_of(scale, most / moved);
  }
  for (int64_t i = 0; i < n; i++)
    x[i] = most_of(least_of(k->before[i] + scale * (x[i] - k->before[i]), high[i]), low[i]);
  if (!blocked(k, k->before, x, least, samples, 0.0, 0, &scale, &at)) at = 1.0;
  for (int64_t i = 0; i < n; i++) k->goal[i] = at < 1.0 ? k->before[i] + at * (x[i] - k->before[i]) : x[i];
  return why;
}

/* Whether the straight way from `before` to `goal` is free, or only leads out: 0; else the first pair in it, plus 1. */
int64_t Walls_way(const Walls *k) {
  double frames[k->n][12], points[k->p][3], least[k->w * k->s];
  Nearest found[k->w * k->s];
  look_at(k, k->before, k->near, frames, points, found);
  for (int64_t i = 0; i < k->w * k->s; i++) least[i] = least_of(found[i].value, 0.0);
  grouped(k, least);
  double at;
  return blocked(k, k->before, k->goal, least, k->samples, k->along, found, k->share, &at);
}

/* How much of the step of a move to `goal` is slow enough before other arms, into `share`; the pair that asks for it, plus 1. */
int64_t Walls_slow(const Walls *k, double share) {
  double frames[k->n][12], points[k->p][3], least[k->w * k->s];
  Nearest found[k->w * k->s], then[k->w * k->s];
  look_at(k, k->before, k->near, frames, points, found);
  look_at(k, k->goal, k->near, frames, points, then);
  allowed(k, share, 1, found, least);
  int64_t why = 0;
  *k->share = 1.0;
  for (int64_t i = 0; i < k->w * k->s; i++) {
    double value = found[i].value, most = value - least[i], nearer = value - then[i].value;
    if (k->group[i / k->s] >= 0 && value > 0.0 && value < k->near && most < *k->share * nearer)
      *k->share = most / nearer, why = i + 1;
  }
  return why;
}

/* Distances at `goal` into `value` (w, s). */
int64_t Walls_look(const Walls *k) {
  double frames[k->n][12], points[k->p][3];
  Nearest found[k->w * k->s];
  look_at(k, k->goal, INFINITY, frames, points, found);
  for (int64_t i = 0; i < k->w * k->s; i++) k->value[i] = found[i].value;
  return 0;
}

/* Whether a pair is the nearest of those of its segment with one other arm. */
static int is_nearest(const Walls *k, const Nearest *found, int64_t pair) {
  for (int64_t w = 0; w < k->w && k->group[pair / k->s] >= 0; w++) {
    int64_t other = k->s * w + pair % k->s;
    if (k->group[w] != k->group[pair / k->s]) continue;
    if (found[other].value < found[pair].value || (found[other].value == found[pair].value && other < pair)) return 0;
  }
  return 1;
}

/* The efforts of springs and dampers before walls, for joints `goal` that move at `rates`; returns whether there are any. */
int64_t Walls_push(const Walls *k) {
  double frames[k->n][12], points[k->p][3], slope[k->n];
  int64_t any = 0;
  Nearest found[k->w * k->s];
  memset(k->efforts, 0, sizeof slope);
  look_at(k, k->goal, k->zone, frames, points, found);
  for (int64_t i = 0; i < k->w * k->s; i++) {
    if (!(found[i].value < k->zone) || !is_nearest(k, found, i)) continue;
    slope_of(k, i % k->s, found + i, frames, points, slope);
    double force = k->spring * (k->zone - found[i].value) - k->damper * dot(slope, k->rates, k->n);
    force = most_of(least_of(force, k->largest), 0.0);
    for (int64_t j = 0; j < k->n; j++) k->efforts[j] += force * slope[j];
    any = 1;
  }
  return any;
}
