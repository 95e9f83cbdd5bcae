"""Edges and velocity words against the analytic motion."""

from __future__ import annotations

import math

import numpy as np
import pytest

from trocar.procs.boards.controllers.encoder import Encoders
from trocar.procs.boards.controllers.lines import Floats
from trocar.procs.fpga import registers as reg

STEP = 49152  # ticks of a millisecond
PER_TICK = 1.0 / reg.CLOCK_HZ


class EncoderBench:
    """Four axes; axis 0 moves as asked, sample by sample, over any number of steps."""

    def __init__(self, x: float = 0.25) -> None:
        self.encoders = Encoders(1)
        self.x = np.array([x, 0.5, 0.5, 0.5])
        self.encoders.place(self.x)
        self.tick = 0

    def step(self, v: float, a: float = 0.0) -> None:
        """One step at v counts/s and a counts/s²."""
        self.encoders.observe(self.tick)
        speed, half = np.zeros(4), np.zeros(4)
        speed[0], half[0] = v * PER_TICK, 0.5 * a * PER_TICK**2
        self.encoders.follow(self.tick, STEP, np.array((self.x, speed, half)))
        self.x = self.x + speed * STEP + half * STEP**2
        self.tick += STEP

    def words(self, tick: int) -> list[int]:
        self.encoders.observe(tick)
        self.encoders.words(tick)
        found: list[int] = self.encoders.shown[0, :, 0].tolist()
        return found


def _speed(period: int) -> float:
    sign = 1.0 if period & reg.VELOCITY_DIRECTION else -1.0
    return sign * 4.0 * reg.CLOCK_HZ / (period & reg.VELOCITY_TICKS_MASK)


def _edge_times(x0: float, v: float, a: float, end_s: float) -> list[int]:
    """Ticks of all crossings of whole numbers up to end_s, by brute force bisection on monotone pieces."""
    times = []
    turn = -v / a if a and -v / a > 0.0 else 0.0
    for first, last in ((0.0, min(turn, end_s)), (turn, end_s)):
        if not 0.0 <= first < last:
            continue
        at = [x0 + v * t + 0.5 * a * t * t for t in (first, last)]
        whole = np.arange(math.floor(min(at)) + 1, math.floor(max(at)) + 1)
        for k in whole if at[1] > at[0] else whole[::-1]:
            low, high = first, last
            for _ in range(80):
                middle = 0.5 * (low + high)
                before = (x0 + v * middle + 0.5 * a * middle**2 < k) == (at[1] > at[0])
                low, high = (middle, high) if before else (low, middle)
            times.append(math.ceil(high * reg.CLOCK_HZ - 1e-6))
    return times


def test_power_up_words_are_the_documented_ones() -> None:
    position, period, quarter_1, quarter_5, running = EncoderBench().words(0)
    assert position & 0x1FFFFFF == 0x800000
    assert (period, quarter_1, quarter_5) == (0xCBFFFFFF, 0x43FFFFFF, 0x43FFFFFF)
    assert EncoderBench().words(0)[4] == 0x83FFFFFF == running


@pytest.mark.parametrize("speed", [3000.0, -3000.0, 120000.0, -777.0, 5.5e6])
def test_constant_speed_gives_the_exact_period(speed: float) -> None:
    bench = EncoderBench()
    for _ in range(60):
        bench.step(speed)
    tick = bench.tick - 1234
    position, period, quarter_1, quarter_5, running = bench.words(tick)
    ticks = reg.CLOCK_HZ / abs(speed)  # between edges
    lag = 2 if speed > 0.0 else 0  # the first edge of all counts downwards
    assert (position & 0xFFFFFF) - 0x800000 == math.floor(0.25 + speed * tick * PER_TICK) - lag
    assert bool(period & reg.VELOCITY_DIRECTION) == (speed > 0)
    assert period & 0xB8000000 == 0
    assert abs((period & reg.VELOCITY_TICKS_MASK) - (4 * ticks - 4)) <= 1
    for quarter in (quarter_1, quarter_5):
        assert abs((quarter & reg.VELOCITY_TICKS_MASK) - (ticks - 1)) <= 1
    assert quarter_1 >> 26 == quarter_5 >> 26  # the same kind of edge, four edges apart
    assert 0 <= running & reg.VELOCITY_TICKS_MASK <= ticks


@pytest.mark.parametrize(("v", "a"), [(2000.0, 9e4), (-2000.0, 4e5), (9000.0, -6e5), (0.0, 3e5), (-150.0, 2e4)])
@pytest.mark.parametrize("every", [STEP, 13_337])
def test_edges_of_accelerated_motion_are_right_to_a_tick(v: float, a: float, every: int) -> None:
    bench, sample = EncoderBench(), 0
    for k in range(30):
        start_s = k * 1e-3
        while sample <= bench.tick:
            bench.encoders.observe(sample)
            sample += every
        bench.step(v + a * start_s, a)
    tick = bench.tick - 20_000
    _, period, quarter_1, quarter_5, running = bench.words(tick)
    edges = _edge_times(0.25, v, a, tick * PER_TICK)[-6:]
    assert len(edges) == 6
    assert abs((running & reg.VELOCITY_TICKS_MASK) - (tick - edges[5])) <= 2
    assert abs((quarter_1 & reg.VELOCITY_TICKS_MASK) - (edges[5] - edges[4] - 1)) <= 2
    assert abs((quarter_5 & reg.VELOCITY_TICKS_MASK) - (edges[1] - edges[0] - 1)) <= 2
    assert abs((period & reg.VELOCITY_TICKS_MASK) - (edges[5] - edges[1] - 4)) <= 3


def test_reversal_within_a_step_counts_every_edge_and_says_so() -> None:
    bench = EncoderBench(x=0.5)
    bench.step(4000.0, -8e6)  # up one count and back down within half a millisecond
    bench.encoders.observe(STEP)
    edges = _edge_times(0.5, 4000.0, -8e6, 1e-3)
    _, period, quarter_1, _, running = bench.words(STEP)
    assert period & reg.PERIOD_DIRECTION_CHANGED
    assert len(edges) == 2
    assert (running & reg.VELOCITY_TICKS_MASK) == STEP - edges[-1]
    assert (quarter_1 & reg.VELOCITY_TICKS_MASK) == edges[-1] - edges[-2] - 1
    assert not running & reg.VELOCITY_DIRECTION


def test_edge_back_over_the_same_line_is_its_opposite() -> None:
    bench = EncoderBench(x=0.9)
    bench.step(200.0)  # crosses 1 upwards: A rises
    up = bench.words(bench.tick)[2]
    bench.step(-200.0)
    down = bench.words(bench.tick)[2]
    assert up >> 26 & 0xF == reg.EDGE_A_UP
    assert down >> 26 & 0xF == reg.EDGE_A_DOWN
    assert bench.words(bench.tick)[1] & (reg.PERIOD_DIRECTION_CHANGED | reg.PERIOD_PARTIAL)


def test_direction_error_never_arises_and_edges_follow_in_order() -> None:
    bench, seen = EncoderBench(), []
    for _ in range(8):
        bench.step(1000.0)
        seen.append(bench.words(bench.tick)[2] >> 26 & 0xF)
    assert seen == [8, 4, 2, 1, 8, 4, 2, 1]


def test_standstill_saturates_the_running_counter() -> None:
    bench = EncoderBench()
    for _ in range(10):
        bench.step(5000.0)
    for _ in range(1400):
        bench.step(0.0)
    _, period, _, _, running = bench.words(bench.tick)
    assert running == reg.VELOCITY_OVERFLOW | reg.VELOCITY_DIRECTION | reg.VELOCITY_TICKS_MASK
    assert _speed(period) == pytest.approx(5000.0, rel=1e-3)  # the last period stays; the host looks at running


def test_edge_after_a_long_rest_overflows_the_period() -> None:
    bench = EncoderBench()
    for _ in range(10):
        bench.step(5000.0)
    for _ in range(1400):
        bench.step(0.0)
    bench.step(1000.0)
    _, period, quarter_1, _, _ = bench.words(bench.tick)
    assert quarter_1 & reg.VELOCITY_OVERFLOW
    assert quarter_1 & reg.VELOCITY_TICKS_MASK == reg.VELOCITY_TICKS_MASK
    assert period & reg.VELOCITY_OVERFLOW


def test_preload_moves_the_counter_and_leaves_the_edges() -> None:
    bench = EncoderBench()
    for _ in range(5):
        bench.step(7000.0)
    before = bench.words(bench.tick)
    bench.encoders.load(np.array([0]), np.array([0x801000]))
    after = bench.words(bench.tick)
    assert after[0] & 0x1FFFFFF == 0x801000
    assert after[1:] == before[1:]
    bench.step(7000.0)
    assert (bench.words(bench.tick)[0] & 0xFFFFFF) - 0x801000 == 7


def test_overflow_bit_stays_once_the_counter_went_over() -> None:
    bench = EncoderBench()
    bench.encoders.load(np.array([0]), np.array([0xFFFFFE]))
    bench.step(7000.0)
    position = bench.words(bench.tick)[0]
    assert position & reg.ENCODER_OVERFLOW
    assert position & 0xFFFFFF == 3
    bench.step(-7000.0)
    assert bench.words(bench.tick)[0] & reg.ENCODER_OVERFLOW


def test_pins_show_the_phase_in_the_digital_inputs() -> None:
    bench = EncoderBench(x=2.5)  # A and B high
    position = bench.words(0)[0]
    assert position & reg.ENCODER_PIN_A and position & reg.ENCODER_PIN_B
    assert int(bench.encoders.pins[0]) & 0x11 << 20 == 0x11 << 20


def test_at_rest_only_the_running_counter_goes_on() -> None:
    bench = EncoderBench()
    for _ in range(3):
        bench.step(7000.0)
    bench.step(0.0)
    first = bench.words(bench.tick - 4000)
    second = bench.words(bench.tick - 1000)
    assert second[:4] == first[:4]
    assert second[4] - first[4] == 3000
    bench.encoders.jump(0, 5)
    assert bench.words(bench.tick)[0] & reg.ENCODER_MASK == (first[0] & reg.ENCODER_MASK) + 5


@pytest.mark.parametrize("width", [4, 7, 8, 10])
def test_boards_of_any_width_keep_their_axes_apart(width: int) -> None:
    encoders, slots = Encoders(3, width), np.arange(3 * width)
    x: Floats = slots + np.full(3 * width, 0.5)
    encoders.place(x)
    encoders.observe(0)
    encoders.follow(0, STEP, np.array((x, 10.0 / STEP * slots, 0.0 * slots)))  # slot k moves 10 · k counts
    position, period = encoders.shown[:, 0], encoders.shown[:, 1]
    encoders.observe(STEP)
    encoders.words(STEP)
    assert (position & reg.ENCODER_MASK).ravel().tolist() == [
        reg.ENCODER_ZERO + (10 * slot - 2 if slot else 0) for slot in slots]
    assert (period & reg.VELOCITY_DIRECTION).ravel().astype(bool).all()
    lines = position >> 28 & 3  # A, B
    for board in range(3):
        shown = int(encoders.pins[board])
        assert [shown >> reg.INPUT_ENCODER_A_SHIFT + k & 1 for k in range(4)] == (lines[board, :4] & 1).tolist()
        assert [shown >> reg.INPUT_ENCODER_B_SHIFT + k & 1 for k in range(4)] == (lines[board, :4] >> 1).tolist()
        assert shown & ~(0xFF << 20) == 0
