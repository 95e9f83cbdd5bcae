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


def test_a_long_standstill_saturates_the_running_counter_and_the_edge_after_it_overflows_the_period() -> None:
    bench = EncoderBench()
    for _ in range(10):
        bench.step(5000.0)
    for _ in range(1400):
        bench.step(0.0)
    _, period, _, _, running = bench.words(bench.tick)
    assert running == reg.VELOCITY_OVERFLOW | reg.VELOCITY_DIRECTION | reg.VELOCITY_TICKS_MASK
    assert _speed(period) == pytest.approx(5000.0, rel=1e-3)  # the last period stays; the host looks at running
    bench.step(1000.0)
    _, period, quarter_1, _, _ = bench.words(bench.tick)
    assert quarter_1 & reg.VELOCITY_OVERFLOW and period & reg.VELOCITY_OVERFLOW
    assert quarter_1 & reg.VELOCITY_TICKS_MASK == reg.VELOCITY_TICKS_MASK


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
