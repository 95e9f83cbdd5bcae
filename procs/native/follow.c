/* A cycle of a PSM teleoperation in which it follows and nothing else happens, as procs/teleop/teleop.py and psm.py do
   it. In any other cycle nothing is done, and Python does it; see procs/teleop/steady.py. */
#define _GNU_SOURCE
#include "fields.h"
#include "numeric.h"
#include "rings.h"
#include "times.h"
#include <stdlib.h>

enum { MASTER, SLAVE };  // the first rings
enum { SENT_AT, TAKEN_AT, ANSWERED_AT };  // cursors
enum { POSE_COMMAND, JAW_COMMAND };
enum { OUTCOME_AT = REPLY_START + 8, TEXT_AT };

/* -- what is as usual ---------------------------------------------------------------------------------------------- */

static int are_usual(const Follow *k, int64_t now_ns) {
  for (int64_t r = 0; r < k->rings; r++) {
    uint8_t *record = (uint8_t *)(intptr_t)k->copy[r];
    if (!read_newest(k->head[r], k->slots[r], k->depth[r], k->stride[r], k->size[r], k->seen + r, record)) return 0;
    k->stamps[r] = stamp_of(record);
    if (k->stamps[r] <= 0 || llabs(now_ns - k->stamps[r]) > k->late_ns[r]) return 0;
  }
  for (int64_t p = 0; p < k->parts; p++)
    if (memcmp((const void *)(intptr_t)k->part_at[p], k->part_was + p * k->room, k->part_size[p])) return 0;
  for (int64_t c = 0; c < k->cells; c++)
    if (loaded(k->cell_at[c]) != k->cell_was[c]) return 0;
  return 1;
}

/* Whether all new answers of the slave are that a command is done, with a text that is not reported. */
static int is_obeyed(const Follow *k, int64_t *seen, int64_t *done_to) {
  int64_t head = (int64_t)loaded(k->cursors[ANSWERED_AT]);
  if (head < *seen || head - *seen >= REPLIES_DEPTH) return 0;
  for (; *seen < head; ++*seen) {
    int64_t slot = k->replies[(*seen + 1) % REPLIES_DEPTH], plain = 0;
    const char *reply = (const char *)(intptr_t)slot;
    if (reply[OUTCOME_AT] != DONE) return 0;
    for (int64_t t = 0; t < k->texts; t++)
      plain |= !strncmp(reply + TEXT_AT, (const char *)k->quiet + t * k->room, k->room);
    memcpy(done_to, reply + REPLY_START, sizeof *done_to);
    __atomic_thread_fence(__ATOMIC_ACQUIRE);
    if (!plain || __atomic_load_n((const int64_t *)(intptr_t)slot, __ATOMIC_RELAXED) != *seen + 1) return 0;  // B3
  }
  return 1;
}

/* -- poses: procs/kinematics/poses.py ------------------------------------------------------------------------------ */

static void multiplied(const double *a, const double *b, double *out) {
  double x = a[3] * b[0] + a[0] * b[3] + a[1] * b[2] - a[2] * b[1];
  double y = a[3] * b[1] - a[0] * b[2] + a[1] * b[3] + a[2] * b[0];
  double z = a[3] * b[2] + a[0] * b[1] - a[1] * b[0] + a[2] * b[3];
  double w = a[3] * b[3] - a[0] * b[0] - a[1] * b[1] - a[2] * b[2];
  out[0] = x, out[1] = y, out[2] = z, out[3] = w;
}

static void conjugated(const double *q, double *out) {
  for (int i = 0; i < 3; i++) out[i] = -q[i];
  out[3] = q[3];
}

static void turned(const double *q, const double *v, double *out) {
  double x = q[0], y = q[1], z = q[2], w = q[3], a = v[0], b = v[1], c = v[2];
  double u = 2.0 * (y * c - z * b), s = 2.0 * (z * a - x * c), t = 2.0 * (x * b - y * a);
  out[0] = a + w * u + y * t - z * s;
  out[1] = b + w * s + z * u - x * t;
  out[2] = c + w * t + x * s - y * u;
}

static double angle_between(const double *first, const double *second) {
  double q[4];
  conjugated(first + 3, q);
  multiplied(q, second + 3, q);
  return 2.0 * atan2(sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]), fabs(q[3]));
}

static double squares(const double *v, int n) {
  double sum = 0.0;
  for (int i = 0; i < n; i++) sum += v[i] * v[i];
  return sum;
}

static int is_finite(const double *measured, const double *setpoint) {
  return isfinite(squares(measured, 7) + squares(setpoint, 7));
}

/* -- the master's motion: procs/teleop/motion_check.py ------------------------------------------------------------- */

static int is_plausible(const Follow *k, int64_t now_ns, double *rooms) {
  memcpy(rooms, k->numbers + NUMBER_ROOM_M, 2 * sizeof *rooms);
  if (k->stamps[MASTER] == k->words[FOLLOW_STAMP]) return 1;
  int64_t passed_ns = k->stamps[MASTER] - k->words[FOLLOW_STAMP], since_ns = now_ns - k->words[FOLLOW_SEEN];
  if (since_ns > passed_ns) passed_ns = since_ns;
  double passed_s = (double)(passed_ns < k->longest_step_ns ? passed_ns : k->longest_step_ns) * 1e-9, way[3];
  for (int i = 0; i < 3; i++) way[i] = k->pose[i] - k->last[i];
  double room_m = rooms[0] + k->most_m_s * passed_s - sqrt(squares(way, 3));
  double room_rad = rooms[1] + k->most_rad_s * passed_s - angle_between(k->pose, k->last);
  rooms[0] = least_of(room_m, k->step_m);
  rooms[1] = least_of(room_rad, k->step_rad);
  return room_m >= 0.0 && room_rad >= 0.0 && sqrt(squares(k->twist, 3)) <= k->most_m_s
         && sqrt(squares(k->twist + 3, 3)) <= k->most_rad_s;
}

/* -- mapping: procs/teleop/teleoperation.py ------------------------------------------------------------------------ */

static void map_pose(const Follow *k, double *goal, double *offset) {
  const int64_t *is = k->words;
  double place[3], turn[4], back[4];
  memcpy(place, k->first_slave, sizeof place);
  memcpy(turn, k->first_slave + 3, sizeof turn);
  for (int i = 0; i < 3 && !is[FOLLOW_TRANSLATION_LOCKED]; i++)
    place[i] = place[i] + k->numbers[NUMBER_SCALE] * (k->pose[i] - k->first_master[i]);
  if (!is[FOLLOW_ROTATION_LOCKED]) multiplied(k->pose + 3, k->first_offset, turn);
  if (is[FOLLOW_CARRIED]) {
    double moved[3];
    conjugated(k->base + 3, back);
    turned(k->first_base + 3, place, moved);
    for (int i = 0; i < 3; i++) moved[i] = k->first_base[i] + moved[i] - k->base[i];
    turned(back, moved, place);
    multiplied(k->first_base + 3, turn, turn);
    multiplied(back, turn, turn);
  }
  double length = copysign(sqrt(squares(turn, 4)), turn[3]);
  memcpy(goal, place, sizeof place);
  for (int i = 0; i < 4; i++) goal[3 + i] = turn[i] / length;
  conjugated(k->pose + 3, back);
  multiplied(back, goal + 3, offset);
}

static void map_twist(const Follow *k, double *twist) {
  const int64_t *is = k->words;
  double scale = is[FOLLOW_LINEAR] && !is[FOLLOW_TRANSLATION_LOCKED] ? k->numbers[NUMBER_SCALE] : 0.0;
  double turn = is[FOLLOW_ANGULAR] && !is[FOLLOW_ROTATION_LOCKED] ? 1.0 : 0.0;
  for (int i = 0; i < 6; i++) twist[i] = (i < 3 ? scale : turn) * k->twist[i];
}

static double map_jaw(const Follow *k, double passed_s) {
  double *x = k->numbers, factor = x[NUMBER_FACTOR], offset = x[NUMBER_OFFSET];
  int64_t *words = k->words;
  if (factor == 0.0) return x[NUMBER_BEGUN];
  double gripper = *k->gripper_valid ? *k->gripper : NAN, ghost = x[NUMBER_GHOST];
  if (isfinite(gripper)) words[FOLLOW_HAS_GRIPPER] = 1;
  else gripper = words[FOLLOW_HAS_GRIPPER] ? ghost : (k->no_gripper_jaw - offset) / factor;
  if (fabs(gripper - ghost) < k->caught_up) words[FOLLOW_CATCHING_UP] = 0;
  double most = x[words[FOLLOW_CATCHING_UP] ? NUMBER_SLOW_RATE : NUMBER_RATE];
  most *= passed_s < 0.0 ? 0.0 : passed_s > k->most_lost_s ? k->most_lost_s : passed_s;
  double step = gripper - ghost;
  x[NUMBER_GHOST] = ghost = ghost + (step > most ? most : step < -most ? -most : step);
  double jaw = factor * ghost + offset;
  if (!(jaw < x[NUMBER_LOWER])) return jaw;
  x[NUMBER_GHOST] = (x[NUMBER_LOWER] - offset) / factor;
  return x[NUMBER_LOWER];
}

/* -- commands: shm/mailbox/mailbox.py ------------------------------------------------------------------------------ */

static void command(const Follow *k, int64_t which, const double *values, int64_t count) {
  int64_t n = ++k->words[FOLLOW_COUNT], now_ns = time_ns(CLOCK_MONOTONIC);
  uint8_t *slot = (uint8_t *)(intptr_t)k->queue[n % COMMANDS_DEPTH];
  memcpy(slot, k->heads + which * VALUES_IN_RAW, VALUES_IN_RAW);  // M2
  memcpy(slot, &now_ns, sizeof now_ns);
  memcpy(slot + sizeof now_ns, &n, sizeof n);
  memcpy(slot + VALUES_IN_RAW, values, sizeof *values * count);
  k->goals[n % GOALS] = which == POSE_COMMAND ? n : 0;
  __atomic_store_n((int64_t *)(intptr_t)k->cursors[SENT_AT], n, __ATOMIC_RELEASE);  // M3
}

/* 1: done. 0: nothing is changed except the records read; so after `over_ns`, when nothing may be sent any more. */
int64_t Follow_go_on(const Follow *k, int64_t now_ns, int64_t over_ns) {
  int64_t *words = k->words, answered = words[FOLLOW_ANSWERED], done_to = words[FOLLOW_DONE_TO];
  double rooms[2], goal[13];
  if (!are_usual(k, now_ns) || !is_finite(k->pose, k->setpoint_of_master) || !is_finite(k->pose_of_slave, k->setpoint)
      || !isfinite(squares(k->base, 7)) || !is_plausible(k, now_ns, rooms) || !is_obeyed(k, &answered, &done_to))
    return 0;
  int64_t last = words[FOLLOW_COUNT] + 2;
  if (last - words[FOLLOW_KNOWN] > COMMANDS_DEPTH) words[FOLLOW_KNOWN] = (int64_t)loaded(k->cursors[TAKEN_AT]);
  if (last - words[FOLLOW_KNOWN] > COMMANDS_DEPTH || time_ns(CLOCK_BOOTTIME) > over_ns) return 0;  // M1

  double passed_s = (double)(now_ns - words[FOLLOW_LAST]) * 1e-9;
  words[FOLLOW_LAST] = now_ns;
  words[FOLLOW_ANSWERED] = answered;
  words[FOLLOW_DONE_TO] = done_to;
  if (k->stamps[MASTER] != words[FOLLOW_STAMP]) {
    memcpy(k->numbers + NUMBER_ROOM_M, rooms, sizeof rooms);
    memcpy(k->last, k->pose, 7 * sizeof *k->last);
    words[FOLLOW_STAMP] = k->stamps[MASTER];
    words[FOLLOW_SEEN] = now_ns;
  }
  memcpy(k->master_measured, k->pose, 7 * sizeof *goal);
  memcpy(k->master_setpoint, k->setpoint_of_master, 7 * sizeof *goal);
  memcpy(k->slave_measured, k->pose_of_slave, 7 * sizeof *goal);
  memcpy(k->slave_setpoint, k->setpoint, 7 * sizeof *goal);
  memcpy(k->base_seen, k->base, 7 * sizeof *goal);
  map_pose(k, goal, k->offset);
  int64_t has_twist = words[FOLLOW_LINEAR] || words[FOLLOW_ANGULAR];
  if (has_twist) map_twist(k, goal + 7);
  command(k, POSE_COMMAND, goal, has_twist ? 13 : 7);
  *k->sent_ns = now_ns;
  memcpy(k->goal, goal, 7 * sizeof *goal);
  if (words[FOLLOW_JAWS]) {
    *k->jaw_shown = map_jaw(k, passed_s);
    *k->ghost_shown = k->numbers[NUMBER_GHOST];
    if (fabs(*k->jaw_shown - *k->jaw) > k->same_jaw) command(k, JAW_COMMAND, k->jaw_shown, 1);
  }
  *k->error = angle_between(k->pose, k->setpoint);
  *k->master_stamp = k->stamps[MASTER];
  *k->slave_stamp = k->stamps[SLAVE];
  memcpy(k->pose_shown, k->pose, 7 * sizeof *goal);
  memcpy(k->setpoint_shown, k->setpoint, 7 * sizeof *goal);
  memcpy(k->twist_shown, k->twist, 6 * sizeof *goal);
  return 1;
}
