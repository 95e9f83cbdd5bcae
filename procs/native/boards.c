/* The emulated boards' stages. Each function is the method of the same name in procs/boards, to the bit. */
#include "fields.h"
#include "numeric.h"
#include <arpa/inet.h>
#include <string.h>

/* -- encoders: procs/boards/controllers/encoder.py, edges.py ------------------------------------------------------- */

enum { EDGES = 6, PINS_SHOWN = 4 };
enum { POSITION, PERIOD, QUARTER_1, QUARTER_5, RUNNING, INPUTS, BEHIND };

int64_t Encoders_set_out(const Encoders *k, int64_t shift, int64_t span) {
  int64_t n = k->n, any = 0;
  for (int64_t i = 0; i < EDGES * n; i++) k->queue[i] -= shift;
  for (int64_t i = 0; i < n; i++) {
    double x0 = k->curve[i], v = k->curve[n + i], h = k->curve[2 * n + i], length = (double)span;
    k->turned[i] = (h * (2.0 * length) + v) * v < 0.0;
    k->hidden[i] = 0;
    if (!k->turned[i]) continue;
    double half_speed = 0.5 * v, peak = floor(x0 - half_speed * (half_speed / h));
    double begin = floor(x0), end = floor((h * length + v) * length + x0);
    any += k->hidden[i] = peak > most_of(begin, end) || peak < least_of(begin, end);
  }
  return any;
}

int64_t Encoders_advance(const Encoders *k, double tau) {
  int64_t n = k->n;
  for (int64_t i = 0; i < n; i++) {
    double x0 = k->curve[i], v = k->curve[n + i], h = k->curve[2 * n + i];
    double is = floor((h * tau + v) * tau + x0), moved = is - k->was[i], half_speed = v * 0.5;
    k->was[i] = is;
    if (moved == 0.0) continue;
    int64_t key = moved >= EDGES ? EDGES : moved > -EDGES ? (int64_t)moved : -EDGES, count = key < 0 ? -key : key;
    int64_t *queue = k->queue + i, fresh[EDGES];
    for (int64_t j = 0; j < count; j++) {
      double distance = (key < 0 ? 1.0 + (double)j : -(double)j) + (is - x0);
      double root = copysign(sqrt(most_of(distance * h + half_speed * half_speed, SLOWEST_SQUARE)), v + h);
      if (k->turned[i]) {  // where the axis first ran the other way it is the other solution
        if (v * moved < 0.0) {
          distance = -(root + half_speed) / h;
          root = 1.0 - half_speed;
        }
        if (root == -half_speed) root = 1.0;
      }
      fresh[j] = (int64_t)(distance / (root + half_speed));
    }
    for (int64_t j = EDGES - 1; j >= count; j--) queue[j * n] = queue[(j - count) * n];
    for (int64_t j = 0; j < count; j++) queue[j * n] = fresh[j];
    k->state[i] = k->state_table[k->state[i] + key + EDGES];
  }
  return 0;
}

int64_t Encoders_show(const Encoders *k, int64_t now) {
  static const int64_t late[3] = {0, 0, 4}, early[3] = {4, 1, 5}, spent[3] = {4, 1, 1};
  int64_t n = k->n, width = k->width;
  for (int64_t b = 0; b < k->boards; b++) {
    uint32_t *out = k->rows + b * k->columns + k->first, pins = 0;
    for (int64_t axis = 0; axis < width; axis++) {
      int64_t i = b * width + axis, count = (int64_t)k->was[i];
      const int64_t *queue = k->queue + i, *flags = k->flag_table + k->state[i] + (count & 3);
      int64_t value = (count + k->offset[i] - (flags[BEHIND * k->states] & k->lag[i])) & POSITION_MASK;
      out[axis] = (uint32_t)(value | k->overflow[i] | flags[POSITION]);
      for (int64_t row = PERIOD; row <= RUNNING; row++) {
        int64_t r = row - PERIOD, ticks = now - queue[0];
        if (row < RUNNING) ticks = queue[late[r] * n] - queue[early[r] * n] - spent[r];
        else if (ticks < 0) ticks = 0;
        if (ticks > TICKS) ticks = OVERFLOWED | TICKS;
        out[row * width + axis] = (uint32_t)(ticks | flags[row * k->states]);
      }
      if (axis < PINS_SHOWN) pins += (uint32_t)flags[INPUTS * k->states] << axis;
    }
    k->pins[b] = pins;
  }
  return 0;
}

/* -- samples: procs/boards/controllers/firmware.py, hub.py --------------------------------------------------------- */

enum { HEAD, BLOCK, FIRST = 1, LAST = 2, TOP_SHIFT = 24, COMPARED = 3 };

int64_t Sample_fill(const Sample *k, int64_t which) {
  int64_t width = k->width;
  for (int64_t b = 0; b < k->boards; b++) {
    uint32_t *block = k->rows + b * k->columns + BLOCK, *adc = block + SCALARS, *position = adc + width;
    uint32_t *motor_status = adc + (KINDS - 1) * width;
    if (which & FIRST) {
      block[STATUS_AT] = k->status[b];
      block[INPUTS_AT] = k->pins[b] | k->inputs[b];
    }
    if (which & LAST) {
      block[INPUTS_AT] |= k->outputs[b];
      int below = k->expanded[b] && k->command[b * width + COMPARED] < (k->good[b] ? k->supply : 0.0);
      if (below) block[INPUTS_AT] |= INPUT_MOTOR_SUPPLY;
      for (int64_t axis = 0, i = b * width; axis < width; axis++, i++) {
        position[axis] &= k->pins_shown[i];
        adc[axis] = k->adc[i];
        motor_status[axis] = k->motor_flags[i] | k->command[i];
      }
    }
  }
  return 0;
}

int64_t HubMemory_collect(const HubMemory *k, int64_t sequence, int64_t tick, int64_t boards, int64_t quads) {
  for (int64_t j = 0; j < boards; j++) {
    int64_t b = k->reporting[j], passed = tick - 1 - k->sampled[b];
    k->rows[b * k->columns + BLOCK + STAMP_AT] = passed > 0 ? (uint32_t)passed : 0;
    k->sampled[b] = tick;
  }
  for (int64_t b = 0; b < k->boards; b++)
    k->rows[b * k->columns + HEAD] = k->headers[(sequence & 0xFF) * k->boards + b]
                                     | ((uint32_t)(sequence >> 8 << 24) & k->long_numbers[b]);
  for (int64_t j = 0; j < quads; j++) {
    k->native[j] = k->rows[k->selection[j]];
    k->memory[j] = htonl(k->native[j]);
  }
  return 0;
}

/* -- commands: procs/boards/controllers/block_writes.py ---------------------------------------------------------------- */

int64_t Commands_repeat(const Commands *k) {
  for (int64_t b = 0; b < k->boards; b++) {
    const uint32_t *group = k->block + b * k->columns, *words = group + 1;
    if (group[0] != k->heads[b] || words[k->width]) return 1;
    for (int64_t axis = 0; axis < k->width; axis++)
      if (ntohl(words[axis]) >> TOP_SHIFT != k->last_top[b * k->width + axis]) return 1;
  }
  for (int64_t i = 0; i < k->boards * k->width; i++) {
    uint32_t word = ntohl(k->block[i / k->width * k->columns + 1 + i % k->width]);
    if (k->accept[i]) k->command[i] = word & VALUE_MASK;
    k->dac[i] = k->command[i];
  }
  return 0;
}

/* -- currents, potentiometers, motion: procs/boards/emulation.py --------------------------------------------------- */

enum { ERRORS = 4, COMPARE = 8, TOO_MUCH = 1, BRAKES = 2 };

int64_t World_sense(const World *k, int64_t which) {
  int64_t n = k->slots, news = 0;
  double *flowing = k->truth, *volts = k->truth + n;
  if (which & FIRST) {
    memcpy(k->position, k->world_position, sizeof(double) * k->axes);
    memcpy(k->velocity, k->world_velocity, sizeof(double) * k->axes);
    for (int64_t i = 0; i < n; i++) {
      k->scales[i] = k->amps[i] * k->on[i];
      k->offsets[i] = k->amps[n + i] * k->on[i];
      flowing[i] = k->dac[i] * k->scales[i] + k->offsets[i];
      volts[i] = k->pot_position[k->axis_of[i]] * k->scales[n + i] + k->offsets[n + i];
    }
    for (int64_t i = 0; i < k->axes; i++) k->current[i] = flowing[k->motor_of[i]];
  }
  if (which & LAST) {
    const double *from = which & ERRORS ? k->seen : k->truth;
    for (int64_t i = 0; i < 2 * n; i++)
      k->bits[i] = least_of(most_of(rint(from[i] * k->to_bits[i] + k->to_bits[2 * n + i]), 0.0), 65535.0);
    for (int64_t i = 0; i < n; i++) {
      k->adc[2 * i] = (uint16_t)k->bits[i];
      k->adc[2 * i + 1] = (uint16_t)k->bits[n + i];
      double excess = fabs(k->bits[i] - MIDDLE) - fabs(k->dac[i] - MIDDLE) - CURRENT_EXCESS;
      if (which & COMPARE && excess > 0.0) news |= TOO_MUCH;
    }
    for (int64_t b = 0; b < k->brakes; b++)
      if ((fabs(flowing[k->brake_slots[b]]) >= (k->let_go[b] ? k->holds_off[b] : k->lets_go[b])) != k->let_go[b])
        news |= BRAKES;
  }
  return news;
}

int64_t World_move(const World *k) {
  int64_t n = k->slots;
  for (int64_t i = 0; i < n; i++) {
    double at = k->world_position[k->axis_of[i]] * k->counts_scale[i] + k->counts_offset[i];
    double speed = k->world_velocity[k->axis_of[i]] * k->counts_scale[n + i] + k->counts_offset[n + i];
    double faster = (speed - k->now[n + i]) * 0.5;
    k->curve[i] = k->now[i];
    k->curve[n + i] = (at - k->now[i]) * k->per_tick - faster;
    k->curve[2 * n + i] = faster * k->per_tick;
    k->now[i] = at;
    k->now[n + i] = speed;
  }
  return 0;
}

/* -- robots: procs/boards/robots/plant.py, friction.py ------------------------------------------------------------- */

enum { HEAVY = 1, PUSHED = 2 };

int64_t Plant_apply(const Plant *k, int64_t which) {
  for (int64_t i = 0; i < k->joints; i++) {
    double force = clamped(k->velocity[i] * k->gain[i] + k->spring[i], k->limit[i]);
    k->spring[i] = force - k->velocity[i] * k->damping[i];
    double applied = k->effort[i] - force;
    if (which & HEAVY) applied -= k->weight[i];
    if (which & PUSHED) applied += k->push[i];
    k->applied[i] = applied;
  }
  return 0;
}
