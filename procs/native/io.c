/* The halves of io's cycle: the methods of the same name in procs/io/halves.py, over the same arrays, to the bit. */
#include "fields.h"
#include "numeric.h"
#include <string.h>

enum { CURRENT, TEMPERATURE, OVERFLOW_BIT, SAFETY, POT_ERROR, AMP_ON, VOLTAGE, POSITION, PERIOD, ROWS, LIMITED = 5 };

static const double NEVER = 1e-300;  // stands for 0 ticks where a division needs something

/* -- decode: procs/io/robots.py, procs/fpga/velocity.py ------------------------------------------------------------ */

static void pots(const Io *k) {
  const double *volts = k->values + VOLTAGE * k->d;
  const uint32_t *readings = k->words + VOLTAGE * k->d;
  double summed[k->n + 1];
  int any = 0;
  for (int64_t i = 0; i < k->n; i++) {
    k->pot_position[i] = volts[i] * k->pot_scale[i] + k->pot_offset[i];
    if (k->table_row[i] >= 0) {
      int64_t place = readings[i] < k->entries ? readings[i] : k->entries - 1;
      k->pot_position[i] = k->tables[k->table_row[i] * k->entries + place];
    }
    any |= k->pot_count[i] != 0;
  }
  if (!any) return;
  for (int64_t i = 0; i < k->n; i++) {
    int64_t first = k->pot_first[i], end = first + k->pot_count[i];
    summed[i] = k->pot_position[i];
    for (int64_t j = first; j < end; j++) {
      double part = k->pot_coupling[j * k->n + i] * k->pot_position[j];
      summed[i] = j == first ? part : summed[i] + part;
    }
  }
  memcpy(k->pot_position, summed, sizeof(double) * k->n);
}

static void firmware_velocity(const Io *k) {
  static const double signs[8] = {-1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0};
  for (int64_t i = 0; i < k->n; i++) {
    uint32_t running_word = k->blocks[k->velocity_index[i]], period_word = k->blocks[k->velocity_index[k->n + i]];
    uint32_t quarter5_word = k->blocks[k->velocity_index[2 * k->n + i]];
    uint32_t quarter1_word = k->blocks[k->velocity_index[3 * k->n + i]];
    double hz = k->hz[i];
    double running = most_of(running_word & TICKS, NEVER), period = most_of(period_word & TICKS, 1.0);
    double quarter5 = most_of(quarter5_word & TICKS, NEVER), quarter1 = most_of(quarter1_word & TICKS, NEVER);
    double sign = signs[period_word >> 29], cap = hz / running, speed = 4.0 * hz / period;
    int incomparable = ((period_word ^ quarter1_word) & DIRECTION) || ((quarter5_word ^ quarter1_word) & SAME_EDGE)
                       || quarter5 < 1.0 || quarter1 < MIN_QUARTER;
    double change = quarter5 - quarter1, before = period + change;
    if (quarter5_word >= OVERFLOWED) before = TICKS;
    before = before * (quarter5 + quarter1) * period;
    change = incomparable ? 0.0 : change / before;
    double now = (period * (4.0 * hz) + running * (8.0 * hz)) * change + speed;
    now = most_of(least_of(now, cap), 0.0);
    k->rate[i] = change;
    k->sign[i] = sign;
    k->predicted[i] = now * sign;
  }
}

static void estimate_softly(const Io *k) {
  const uint32_t *counts = k->words + POSITION * k->d;
  const double *dt = k->values + PERIOD * k->d;
  int known = *k->soft_known;
  for (int64_t i = 0; i < k->n; i++) {
    double count = (double)(int32_t)counts[i];
    if (!known) {
      k->soft_previous[i] = count;
      k->soft_since[i] = k->soft_slope[i] = k->soft[i] = 0.0;
    } else {
      double change = count - k->soft_previous[i], young = k->soft_since[i] < SLOWEST_S;
      double velocity = (k->soft[i] - k->soft_slope[i] * dt[i]) * young;
      k->soft_previous[i] = count;
      k->soft_since[i] += dt[i];
      if (change != 0.0) {  // one of the counts took all the time since the last, the others fell into this interval
        double jump = (fabs(change) - 1.0) / most_of(dt[i], NEVER) + 1.0 / most_of(k->soft_since[i], NEVER);
        velocity = k->soft_slope[i] = copysign(jump, change);
        k->soft_since[i] = 0.0;
      }
      k->soft[i] = velocity;
    }
    k->software_velocity[i] = k->soft[i] * k->position_scale[i];
  }
  *k->soft_known = 1;
}

static int watch(const Io *k) {
  for (int64_t b = 0; b < k->boards; b++) {
    uint32_t now = k->blocks[b * k->columns + k->status_column] & k->status_mask[b];
    if (k->relay_unseen[b]) now |= (now & RELAY) << 1;
    k->status_now[b] = now;
  }
  return memcmp(k->status_now, k->status_before, sizeof(uint32_t) * k->boards)
         || memcmp(k->values + AMP_ON * k->d, k->amps_before, sizeof(double) * k->d);
}

/* Blocks to SI units. */
static void decode(const Io *k) {
  for (int64_t i = 0; i < ROWS * k->d; i++) {
    uint32_t word = k->blocks[k->index[i]] >> k->shift[i] & k->mask[i];
    k->words[i] = word;
    k->values[i] = ((double)word + k->bias[i]) * k->scale[i] + k->offset[i];
  }
  pots(k);
  const double *position = k->values + POSITION * k->d;
  double *pot_error = k->values + POT_ERROR * k->d;
  for (int64_t i = 0; i < k->n; i++) pot_error[i] = k->pot_position[i] - position[i];
  firmware_velocity(k);
  if (k->any_software) estimate_softly(k);
  for (int64_t i = 0; i < k->n; i++)
    k->velocity[i] = k->software[i] ? k->software_velocity[i] : k->predicted[i] * k->position_scale[i];
}

/* -- check: procs/io/power.py, procs/io/safety.py, procs/io/pid.py --------------------------------------------------*/

/* 1: something is beyond its limit. */
static int check(const Io *k) {
  int64_t sampled = LIMITED * k->d, all = k->limit_rows * k->d;
  int beyond = 0;
  for (int64_t i = 0; i < sampled; i++) k->magnitude[i] = fabs(k->values[i]);
  for (int64_t i = sampled; i < all; i++)
    k->magnitude[i] = fabs(k->values[CURRENT * k->d + i - sampled] - k->current_request[i - sampled]);
  for (int64_t i = 0; i < all; i++) beyond |= !(k->within_limits[i] = k->magnitude[i] <= k->limits[i]);
  return beyond;
}

enum { DEAD_BAND, SOFT, FILTERS, INTEGRATES, OBSERVES, LIMITS_OUTPUT, OFFSET, ANY_OFF, ANY_EFFORT, CONTRIBUTION };

/* An error's magnitude after the dead-band. */
static double excess_of(const Io *k, int64_t i, double error) {
  double excess = fabs(error);
  if (!k->switches[DEAD_BAND]) return excess;
  excess = most_of(excess - k->pid_p_deadband[i], 0.0);
  if (k->switches[SOFT]) {  // x²(3 − 2x) rises from 0 to 1 between the dead-bands
    double x = fmin(excess * k->per_width[i], 1.0);
    excess = excess * x * x;
    excess = excess * (x * -2.0 + 3.0);
  }
  return excess;
}

/* 1: a tracking error is beyond its tolerance. */
static int compare(const Io *k) {
  const double *position = k->values + POSITION * k->d;
  int beyond = 0;
  for (int64_t i = 0; i < k->n; i++) {
    k->excess[i] = excess_of(k, i, k->setpoint[i] - position[i]);
    beyond |= !(k->within[i] = k->excess[i] <= k->allowed[i]);
  }
  return beyond;
}

int64_t Io_decode_and_check(const Io *k) {
  decode(k);
  return (watch(k) ? STATUS : 0) | (check(k) ? LIMIT : 0) | (compare(k) ? TRACKING : 0);
}

/* -- control: procs/io/pid.py --------------------------------------------------------------------------------------*/

static void rest(const Io *k, int64_t i) {
  k->integral[i] = k->disturbance[i] = k->observer_input[i] = k->observer_state[i] = 0.0;
}

/* The joint controllers of all actuators; 0: some effort was not finite. */
static int control(const Io *k) {
  const int64_t *is = k->switches;
  int all_finite = 1;
  const double *position = k->values + POSITION * k->d, *velocity = k->velocity;
  for (int64_t i = 0; i < k->n; i++) {
    int off = is[ANY_OFF] && k->off[i], in_effort = is[ANY_EFFORT] && k->effort_mode[i], inside = 0;
    double error = k->setpoint[i] - position[i];
    if (is[DEAD_BAND]) {
      inside = fabs(error) < k->pid_p_deadband[i];
      error = copysign(excess_of(k, i, error), error);
    }
    if (in_effort) error = 0.0;

    double feed = k->feed[i];
    if (is[FILTERS]) feed = k->share_old[i] * k->filtered[i] + k->pid_v_low_pass_cutoff[i] * feed;
    feed *= k->has_velocity[i];
    if (inside) feed = k->filtered[i];
    k->filtered[i] = feed;
    double velocity_error = inside ? 0.0 : feed - velocity[i];

    double u = k->pid_p_gain[i] * error + k->pid_d_gain[i] * velocity_error;
    if (is[INTEGRATES]) {
      double sum = clamped(k->integral[i] * k->pid_i_forget_rate[i] + error, k->pid_i_limit[i]);
      k->integral[i] = sum;
      u += sum * k->pid_i_gain[i];
    }
    if (is[OBSERVES]) {
      double x = k->momentum[i] * velocity[i];
      k->observer_state[i] += (k->observer_input[i] + x - k->observer_state[i]) * k->observer_rate[i];
      k->disturbance[i] = k->observer_state[i] - x;
      u += k->disturbance[i];
    }
    if (is[LIMITS_OUTPUT]) u = clamped(u, k->output_limit[i]);

    double effort = is[OFFSET] || is[ANY_EFFORT] ? u + k->pid_offset[i] : u;
    if (in_effort) effort = k->requested[i];
    effort += k->feed_forward[i];
    if (is[CONTRIBUTION]) effort += k->contribution[i];
    effort = clamped(effort, k->effort_limit[i]);
    if (is[OBSERVES]) k->observer_input[i] = clamped(u, k->effort_limit[i]);

    if (off) effort = k->effort_when_off[i], error = 0.0;
    if (off || in_effort) {
      k->setpoint[i] = position[i];
      if (is[INTEGRATES] || is[OBSERVES]) rest(k, i);
    }
    all_finite &= k->finite[i] = isfinite(effort) != 0;
    if (!k->finite[i]) {
      effort = k->filtered[i] = 0.0;
      rest(k, i);
    }
    k->error[i] = error;
    k->effort[i] = effort;
  }
  return all_finite;
}

/* -- encode: procs/io/outputs.py -----------------------------------------------------------------------------------*/

/* A share of the efforts, and the brakes' currents, to words for the boards; 0: some effort was not finite. */
static int encode(const Io *k, double share) {
  int finite = 1;
  for (int64_t i = 0; i < k->d; i++) {
    double current = i < k->n ? k->effort[i] * k->effort_to_current[i] : k->brake_current[i - k->n];
    if (i < k->n && share != 1.0) current *= share;
    current = most_of(least_of(current, k->most[i]), k->least[i]);
    k->current_request[i] = current;
    double bits = current * k->dac_scale[i] + k->dac_offset[i];
    if (!isfinite(bits)) {
      bits = k->dac_zero[i];
      finite = 0;
    }
    k->out_words[i] = ((int64_t)bits & 0xFFFF) | k->out_flags[i];
    k->out[k->out_index[i]] = (uint32_t)k->out_words[i];
  }
  for (int64_t b = 0; b < k->boards; b++) k->out[(b + 1) * k->out_columns - 1] = k->control[b];
  return finite;
}

int64_t Io_control_and_encode(const Io *k, double share, int64_t has_sample) {
  int controlled = !has_sample || control(k), encoded = encode(k, share);
  return (controlled && encoded ? 0 : NOT_FINITE) | (has_sample ? CONTROLLED : 0);
}

/* -- show: procs/io/robots.py, procs/io/digital_outputs.py, procs/io/buttons.py ------------------------------------*/

enum { SOFTWARE_VELOCITY = 1, ACCELERATION = 2 };

static void show_wanted(const Io *k) {
  if (!k->any_software && *k->wanted & SOFTWARE_VELOCITY) {
    int known = *k->soft_known;
    estimate_softly(k);
    for (int64_t i = 0; i < k->n && !known; i++) k->software_velocity[i] = NAN;
  }
  for (int64_t i = 0; i < k->n && *k->wanted & ACCELERATION; i++)
    k->acceleration[i] = k->rate[i] * k->sign[i] * (8.0 * k->hz[i] * k->hz[i]) * k->position_scale[i];
}

/* The rest of the record; 1: an input is, or was, not as its value says. */
int64_t Io_show(const Io *k) {
  show_wanted(k);
  memcpy(k->position, k->values + POSITION * k->d, sizeof(double) * k->n);
  memcpy(k->current, k->values + CURRENT * k->d, sizeof(double) * k->d);
  memcpy(k->temperature, k->values + TEMPERATURE * k->d, sizeof(double) * k->d);
  memcpy(k->pot_voltage, k->values + VOLTAGE * k->d, sizeof(double) * k->n);
  for (int64_t i = 0; i < k->n; i++) {
    k->measured_effort[i] = k->current[i] * k->current_to_effort[i];
    k->pot_bits[i] = (uint16_t)k->words[VOLTAGE * k->d + i];
    k->shown_pot[i] = k->no_pot[i] ? NAN : k->pot_position[i];
    k->firmware_velocity[i] = k->predicted[i] * k->position_scale[i];
    k->encoder_bits[i] = (int32_t)k->words[POSITION * k->d + i] - MIDRANGE;
  }
  for (int64_t i = 0; i < k->d; i++) k->amp_on[i] = k->values[AMP_ON * k->d + i] > 0.5;
  for (int64_t r = 0; r < k->robots; r++) k->board_period[r] = k->values[PERIOD * k->d + k->first_axis[r]];
  for (int64_t i = 0; i < k->outputs; i++)
    k->output[i] = k->output_unseen[i] ? k->output_written[i] : !(k->blocks[k->output_index[i]] & k->output_bit[i]);
  int64_t news = 0;
  for (int64_t i = 0; i < k->inputs; i++) {
    k->pressed[i] = ((k->blocks[k->input_index[i]] & k->input_bit[i]) != 0) != k->when_low[i];
    news |= k->pressed[i] != k->pressed_value[i] || k->pending[i];
  }
  return news;
}
