"""The loop-back board against what the original test programs check, in their order of doing things."""

from __future__ import annotations

import math
from itertools import pairwise
from statistics import median

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from trocar.procs.boards.controllers.quadrature import DELAY
from trocar.procs.boards.controllers.testboard import Loopback
from trocar.procs.boards.devices.outputs import PLAY, BoardOutputs
from trocar.procs.boards.devices.waveform import VALID
from trocar.procs.document.system import Quirks
from trocar.procs.fpga import registers as reg

A, B, INDEX, SWITCHES = 1, 2, 4, 8  # pins of outputs 1 to 4
ZERO = reg.ENCODER_ZERO
ALL = 0xF
FAITHFUL = Quirks()


class HarnessOfTestboard:
    """A board with its test board, handled as the boards do it, pins as the original library writes them."""

    def __init__(self, quirks: Quirks = FAITHFUL, first: int = 0) -> None:
        self.outputs = BoardOutputs(4 + first)
        self.loop = Loopback(self.outputs, first=first, quirks=quirks)
        self.tick, self._first = 0, first
        self.positions = np.zeros(4, dtype=np.uint32)
        self.velocities = np.zeros((4, 4), dtype=np.uint32)

    def wait(self, seconds: float) -> None:
        self.tick += round(seconds * reg.CLOCK_HZ)

    def write(self, mask: int, pins: int, play: int = 0) -> None:
        self.tick += 300  # a packet takes some microseconds
        self.loop.until(self.tick)
        self.outputs.write(mask << 8 + self._first | (~pins & mask) << self._first | play, self.tick)

    def read(self) -> int:
        return self.loop.fill(self.tick, self.positions, self.velocities)

    def counts(self) -> list[int]:
        self.read()
        return [(int(word) & reg.ENCODER_MASK) - ZERO for word in self.positions]

    def preload(self, counts: int) -> None:
        for axis in range(4):
            self.tick += 300
            self.loop.preload(axis, counts + ZERO, self.tick)
        self.wait(1e-4)

    def cycle(self, up: bool) -> None:
        """Four edges, beginning and ending with both lines high."""
        for pins in (A | B, B if up else A, 0, A if up else B, A | B):
            self.write(A | B, pins)
            self.wait(1e-5)
        self.wait(1e-4)


# -- the board test ----------------------------------------------------------------------------------------------------

@pytest.mark.parametrize("first", [0, 4])
def test_output_4_drives_all_switches(first: int) -> None:
    harness = HarnessOfTestboard(first=first)
    for pins, seen in ((0, 0), (SWITCHES, 0xFFF), (0, 0)):
        harness.write(SWITCHES, pins)
        harness.wait(1e-3)
        assert harness.read() & 0xFFF == seen


@pytest.mark.parametrize(("lag", "ups", "downs"), [(True, 2, 0xFE), (False, 4, 0xFC)])
def test_encoders_count_64_cycles_up_and_down(lag: bool, ups: int, downs: int) -> None:
    harness = HarnessOfTestboard(Quirks(direction_lag=lag))
    harness.write(ALL, A | B)
    harness.preload(0)
    assert harness.counts() == [0] * 4
    for k in range(64):
        harness.cycle(up=True)
        assert harness.counts() == [ups + 4 * k] * 4  # the programs let the first one differ, and go on from there
    harness.preload(0x100)
    assert harness.counts() == [0x100] * 4
    for k in range(64):
        harness.cycle(up=False)
        assert harness.counts() == [downs - 4 * k] * 4


def test_axes_are_preloaded_one_by_one() -> None:
    harness = HarnessOfTestboard()
    harness.loop.preload(2, 0x1234, 100)
    harness.tick = 200
    assert harness.counts() == [0, 0, 0x1234 - ZERO, 0]


def test_new_outputs_begin_with_pins_high_and_counters_at_zero() -> None:
    harness = HarnessOfTestboard()
    harness.write(ALL, 0)
    harness.preload(77)
    assert harness.read() == 0
    harness.tick += 1000
    harness.loop.power_up(BoardOutputs(), harness.tick)
    harness.tick += 1000
    assert harness.read() == 0xFFF0FFF | 0xF << 16
    assert harness.counts() == [0] * 4


# -- the encoder test --------------------------------------------------------------------------------------------------

# Acceleration in counts/s² until a velocity in counts/s is reached, or none for a time in s.
PHASES = ((1000.0, 400.0), (0.0, 0.1), (-1000.0, 0.0), (0.0, 0.05), (-1000.0, -400.0), (1000.0, -300.0),
          (10000.0, 100.0), (1000.0, 200.0), (-1000.0, 0.0))
CLOCK = float(reg.CLOCK_HZ)


class Reference:
    """Position and velocity over time; edges where the position reaches another whole number than last time."""

    def __init__(self) -> None:
        self.pieces: list[tuple[float, float, float, float, float]] = []  # begin, end, position, velocity, acceleration
        self.edges: list[tuple[float, int]] = []  # time, counts from then on
        begin, x, v, last = 0.0, 0.0, 0.0, 0
        for a, goal in PHASES:
            span = (goal - v) / a if a else goal
            self.pieces.append((begin, begin + span, x, v, a))
            turning = -v / a if a else -1.0
            stops = [0.0, turning, span] if 1e-9 < turning < span - 1e-9 else [0.0, span]
            for early, late in pairwise(stops):
                low, high = (x + (v + 0.5 * a * t) * t for t in (early, late))
                way = 1 if high > low else -1
                while (high - last) * way >= 1.0 - 1e-9 and high != low:
                    last += way
                    root = math.sqrt(max(v * v + 2.0 * a * (last - x), 0.0))
                    t = (way * root - v) / a if a else (last - x) / v
                    self.edges.append((begin + t, last))
            x, v, begin = x + (v + 0.5 * a * span) * span, v + a * span, begin + span

    def velocity(self, t: float) -> float:
        begin, _, _, v, a = next(piece for piece in self.pieces if t <= piece[1])
        return v + a * (t - begin)

    def table(self) -> list[int]:
        """Waveform entries: how long lines stay as they are before each edge."""
        before, entries, phase = 0.0, [], 0
        for t, counts in self.edges:
            pins = (A | B, B, 0, A)[phase % 4]
            entries.append(VALID | round((t - before) * CLOCK) << 8 | ~pins & ALL)
            before, phase = t, counts
        return [*entries, 0]


def predicted(period: int, quarter_1: int, quarter_5: int, running: int) -> float:
    """Velocity in counts/s as the original library predicts it from the words."""
    if period & (reg.VELOCITY_OVERFLOW | reg.PERIOD_DIRECTION_CHANGED):
        return 0.0
    p, q1, q5 = (word & reg.VELOCITY_TICKS_MASK for word in (period, quarter_1, quarter_5))
    run = (running & reg.VELOCITY_TICKS_MASK) / CLOCK
    sign = 1.0 if period & reg.VELOCITY_DIRECTION else -1.0
    speed, before = 4.0 * CLOCK / p, reg.VELOCITY_TICKS_MASK if quarter_5 & reg.VELOCITY_OVERFLOW else p - q1 + q5
    same = (quarter_1 ^ quarter_5) >> 26 & 0x1F == 0 and not (period ^ quarter_1) & reg.VELOCITY_DIRECTION
    gain = 8.0 * (q5 - q1) * CLOCK**2 / (p * before * (q5 + q1)) if same else 0.0
    speed += gain * (0.5 * p / CLOCK + run)
    return sign * max(0.0, min(speed, 1.0 / run if run else speed))


def test_played_trajectory_gives_the_reference_velocities() -> None:
    reference, harness = Reference(), HarnessOfTestboard()
    table = reference.table()
    assert len(table) == 355
    for pins in (B, 0, A, A | B):  # slow edges, so that periods overflow
        harness.write(A | B, pins)
        harness.wait(1.4)
    harness.preload(0)
    assert harness.counts() == [0] * 4
    harness.loop.until(harness.tick)
    harness.outputs.write_table(0, table, harness.tick)
    harness.write(A | B, A | B, PLAY)
    begin, off, number = harness.tick, [], 0
    while harness.outputs.playing(harness.tick):
        harness.wait(0.0005)
        t = (harness.tick - begin - DELAY) / CLOCK
        counts = harness.counts()
        number = sum(edge <= t - number / CLOCK for edge, _ in reference.edges)  # an entry lasts a tick longer
        if harness.outputs.playing(harness.tick):
            up = number < 2 or reference.edges[number - 1][1] > reference.edges[number - 2][1]
            true = reference.edges[number - 1][1] if number else 0
            assert counts == [true if up else true + 2] * 4
        if 0.06 < t < 0.88:
            words = [int(word) for word in harness.velocities[:, 3]]
            off.append(abs(predicted(*words) - reference.velocity(t)))
    assert len(off) > 1600
    assert median(off) < 0.01  # counts/s; the programs' own tolerance is 0.05
    assert counts == [116] * 4 and reference.edges[-1][1] == 116


# -- looking does not change anything ----------------------------------------------------------------------------------

_writes = st.tuples(st.just("write"), st.integers(1, ALL), st.integers(0, ALL))
_pwm = st.tuples(st.just("pwm"), st.integers(0, 3), st.integers(0, 200) | st.integers(0, 200).map(lambda n: n << 16)
                 # slow enough to be followed switching by switching
                 | st.tuples(*[st.integers(190, 400)] * 2).map(lambda n: n[0] << 16 | n[1]))
_plays = st.tuples(st.just("play"), st.integers(1, ALL), st.lists(st.integers(0, 0x3FFF), max_size=12).map(tuple))


@examples(40)
@given(deeds=st.lists(st.tuples(st.integers(0, 3000), _writes | _pwm | _plays), max_size=8), every=st.integers(1, 300))
def test_words_do_not_depend_on_how_often_they_are_read(
        deeds: list[tuple[int, tuple[object, ...]]], every: int) -> None:
    rare, often = HarnessOfTestboard(), HarnessOfTestboard()
    for span, deed in [*deeds, (2000, ("write", 1, 1))]:
        for harness, gap in ((rare, span + 1), (often, every)):
            for tick in range(harness.tick, harness.tick + span, gap):
                harness.loop.until(tick)
            harness.tick += span
            match deed:
                case ("write", int(mask), int(pins)):
                    harness.write(mask, pins)
                case ("pwm", int(output), int(control)):
                    harness.loop.until(harness.tick)
                    harness.outputs.configure(output, control, harness.tick)
                case ("play", int(mask), tuple(entries)):
                    harness.loop.until(harness.tick)
                    harness.outputs.write_table(0, [VALID | int(entry) for entry in entries] + [0], harness.tick)
                    harness.write(mask, 0, PLAY)
    inputs = rare.read(), often.read()
    assert inputs[0] == inputs[1]
    assert (rare.positions == often.positions).all() and (rare.velocities == often.velocities).all()
