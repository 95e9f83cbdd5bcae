/* Robots that are where their setpoints are: the methods of the same name in procs/io/kinematic.py, to the bit. */
#define _GNU_SOURCE
#include "fields.h"
#include "times.h"
#include <math.h>
#include <string.h>

int64_t Kinematic_move(const Kinematic *k, int64_t now_ns) {
  int anything = 0;
  for (int64_t i = 0; i < k->n; i++) {
    int driven = k->enabled[i] > k->effort_mode[i];
    k->step[i] = driven ? k->setpoint[i] - k->position[i] : 0.0;
    if (driven) k->position[i] = k->setpoint[i];
    anything |= k->step[i] != 0.0;
  }
  for (int64_t f = 0; f < k->followers; f++) {
    int64_t robot = k->robot[f], stamp_ns = k->taken_ns[f], since_ns = stamp_ns - k->stamps_ns[robot];
    int64_t begin = k->first[f], end = begin + k->axes[f];
    int is_moved = k->robot_enabled[robot] && now_ns - stamp_ns <= k->moving_ns;
    k->stamps_ns[robot] = stamp_ns;
    if (anything && since_ns > 0 && is_moved) {
      for (int64_t i = begin; i < end; i++) k->velocity[i] = k->step[i] * (1e9 / (double)since_ns);
      k->moves[robot] = 1;
    } else if (k->moves[robot] && (since_ns > 0 || !is_moved)) {
      for (int64_t i = begin; i < end; i++) k->velocity[i] = 0.0;
      k->moves[robot] = 0;
    }
  }
  return 0;
}

/* Move, and where Python has nothing to do before `wake_ns`, and nothing is commanded, the other half as well. */
int64_t Kinematic_follow(const Kinematic *k, int64_t now_ns, int64_t wake_ns, int64_t over_ns) {
  Kinematic_move(k, now_ns);
  if (now_ns >= wake_ns || memcmp(k->control, k->commanded, sizeof *k->control * k->boards)
      || time_ns(CLOCK_BOOTTIME) > over_ns) return 0;
  Io_control_and_encode((const Io *)(intptr_t)k->io, 1.0, 1);
  for (int64_t i = 0; i < k->drives; i++) k->current_request[i] = NAN;
  return CONTROLLED | SENT;
}
