"""The edge-by-edge encoder against a clock-by-clock one, and against the closed form."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.examples import examples
from trocar.procs.boards.controllers.encoder import Encoders
from trocar.procs.boards.controllers.lines import Floats
from trocar.procs.boards.controllers.quadrature import DELAY, Quadrature
from trocar.procs.document.system import Quirks
from trocar.procs.fpga import registers as reg

Words = tuple[int, ...]
Lines = tuple[int, int]
MOST = 0x3FF_FFFF
UPWARDS = ((1, 0), (1, 1), (0, 1), (0, 0))  # lines A, B after low, low


class Clocked:
    """The registers of the real firmware, moved on by one clock after the other."""

    def __init__(self, lag: bool) -> None:
        self.lag = lag
        self.samples, self.filtered, self.seen = [0, 0], [0, 0], [0, 0]
        self.counter, self.up, self.overflow = reg.ENCODER_ZERO, 0, 0
        self.running, self.running_over = MOST, 1
        self.queue = [(MOST, 0, 1, 0, 0)] * 5  # ticks, overflow, direction, error, type

    def clock(self, lines: Lines) -> None:
        now, before = tuple(self.filtered), tuple(self.seen)
        edges = 8 * (now[0] > before[0]) | 4 * (now[1] > before[1]) | 2 * (now[0] < before[0]) | (now[1] < before[1])
        up = now[0] ^ before[1]
        if edges.bit_count() == 1:
            step = 1 if (self.up if self.lag else up) else -1
            after = (self.counter + step) & 0x1FF_FFFF
            self.overflow |= ~self.counter >> 24 & after >> 24 & 1
            self.counter, self.up = after, up
        if edges:
            self.queue = [(self.running, self.running_over, up, self.wrong(edges, up), edges), *self.queue[:4]]
            self.running, self.running_over = 0, 0
        elif self.running < MOST:
            self.running += 1
        else:
            self.running_over = 1
        self.seen = list(now)
        for k in (0, 1):
            if self.samples[k] in (0, 0x1FF):
                self.filtered[k] = self.samples[k] >> 8
            self.samples[k] = (self.samples[k] << 1 | lines[k]) & 0x1FF

    def wrong(self, edges: int, up: int) -> int:
        *_, last_up, _, last = self.queue[0]
        a_up, b_up, a_down, b_down = (edges >> k & 1 for k in (3, 2, 1, 0))
        if last_up != up:
            wanted = (a_down, b_down, a_up, b_up)
        else:
            wanted = (b_up, a_down, b_down, a_up) if up else (b_down, a_up, b_up, a_down)
        return int(last != 0 and last != int("".join(map(str, wanted)), 2))

    def words(self, lines: Lines) -> Words:
        four = self.queue[:4]
        total = sum(edge[0] for edge in four)
        directions = [edge[2] for edge in four]
        period = ((1 << 31 | MOST if total > MOST else total) | directions[0] << 30 | (len(set(directions)) > 1) << 29
                  | any(edge[3] for edge in four) << 28 | (four[3][4] == 0) << 27)
        quarters = [ticks | over << 31 | up << 30 | kind << 26 for ticks, over, up, _, kind in self.queue]
        return (self.counter & 0xFFFFFF | self.overflow << 24 | lines[0] << 28 | lines[1] << 29, period, quarters[0],
                quarters[4], self.running | self.running_over << 31 | self.up << 30)


def words(quadrature: Quadrature, tick: int) -> Words:
    quadrature.observe(tick)
    return (quadrature.position(), *quadrature.velocity(tick))


_gaps = st.one_of(st.integers(1, 24), st.sampled_from([8, 9, 10, 11, 12]))
_lines = st.tuples(st.integers(0, 1), st.integers(0, 1))
_changes = st.lists(st.tuples(_gaps, _lines), max_size=30)


@examples(100)
@given(lag=st.booleans(), start=_lines, changes=_changes, looks=st.lists(st.booleans(), min_size=8, max_size=8))
def test_every_tick_is_as_in_the_clocked_registers(
        lag: bool, start: Lines, changes: list[tuple[int, Lines]], looks: list[bool]) -> None:
    clocked, quadrature = Clocked(lag), Quadrature(0, *start, quirks=Quirks(direction_lag=lag))
    lines, tick = start, 0
    for gap, then in [*changes, (30, start)]:
        for _ in range(gap):
            clocked.clock(lines)
            tick += 1
            if tick % 8 and looks[tick % 8]:
                assert words(quadrature, tick) == clocked.words(lines), f"tick {tick}"
        lines = then
        quadrature.change(tick, *lines)
        assert words(quadrature, tick) == clocked.words(lines), f"tick {tick}"


def turn(quadrature: Quadrature, tick: int, edges: int, spacing: int = 101) -> int:
    """Some edges upwards, the first at `tick`; the tick of the last one."""
    for k in range(edges):
        quadrature.change(tick + k * spacing, *UPWARDS[k % 4])
    return tick + (edges - 1) * spacing


def test_running_counter_stops_at_its_end_and_says_so_a_tick_later() -> None:
    quadrature = Quadrature(0, 0, 0)
    edge = turn(quadrature, 1000, 6) + DELAY
    assert words(quadrature, edge + MOST - 1)[4] == MOST - 1 | reg.VELOCITY_DIRECTION
    assert words(quadrature, edge + MOST)[4] == MOST | reg.VELOCITY_DIRECTION
    for later in (1, 2, 10**9):
        assert words(quadrature, edge + MOST + later)[4] == MOST | reg.VELOCITY_DIRECTION | reg.VELOCITY_OVERFLOW


@pytest.mark.parametrize(("rest", "over"), [(MOST, 0), (MOST + 1, 0), (MOST + 2, reg.VELOCITY_OVERFLOW)])
def test_edge_after_a_rest_stores_the_end_and_whether_it_passed(rest: int, over: int) -> None:
    quadrature = Quadrature(0, 0, 0)
    last = turn(quadrature, 1000, 6)
    quadrature.change(last + rest, 0, 1)
    period, quarter_1, *_ = words(quadrature, last + rest + DELAY)[1:]
    assert quarter_1 & (MOST | reg.VELOCITY_OVERFLOW) == min(rest - 1, MOST) | over
    assert period & reg.VELOCITY_OVERFLOW and period & MOST == MOST


@pytest.mark.parametrize("sticky", [True, False])
def test_counters_of_the_same_lines_overflow_each_on_its_own(sticky: bool) -> None:
    quadrature = Quadrature(0, 0, 0, counters=2, quirks=Quirks(sticky_overflow=sticky))
    last = turn(quadrature, 1000, 4)
    quadrature.observe(last + DELAY)
    quadrature.load(0, 0xFFFFFE)
    last = turn(quadrature, last + 100, 4)
    quadrature.observe(last + DELAY)
    assert [quadrature.position(k) for k in (0, 1)] == [reg.ENCODER_OVERFLOW | 2, 0x800000 - 1 + 7]
    quadrature.load(1, 0x1234)
    assert quadrature.position(0) == reg.ENCODER_OVERFLOW | 2
    quadrature.load(0, 0x1234)
    assert quadrature.position(0) == 0x1234 | (reg.ENCODER_OVERFLOW if sticky else 0)
    assert quadrature.position(1) == 0x1234


# -- against the closed form -------------------------------------------------------------------------------------------

STEP = 49152


def crossings(x0: float, v: float, h: float) -> list[tuple[int, int]]:
    """(ticks into the step, number below) of every edge of x0 + v·τ + h·τ² within a step, in order of time."""

    def x(tau: float) -> float:
        return x0 + (v + h * tau) * tau

    turning = -v / (2.0 * h) if h else -1.0
    stops = [0.0, turning, float(STEP)] if 0.0 < turning < STEP else [0.0, float(STEP)]
    found = []
    for first, last in pairwise(stops):
        up = x(last) > x(first)
        low, high = sorted((math.floor(x(first)), math.floor(x(last))))
        whole = range(low + 1, high + 1)
        for k in whole if up else reversed(whole):
            early, late = (math.ceil(_bisect(x, k + off, first, last, up)) for off in (-1e-7, 1e-7))
            assume(early == late)  # on a tick to a hair: either would do
            found.append((early, k if up else k - 1))
    return found


def _bisect(x: Callable[[float], float], k: float, first: float, last: float, up: bool) -> float:
    for _ in range(70):
        middle = 0.5 * (first + last)
        first, last = (middle, last) if (x(middle) < k) == up else (first, middle)
    return last


_goals = st.lists(st.tuples(st.floats(-9.0, 9.0), st.floats(-40.0, 40.0)), min_size=1, max_size=8)


@examples(60)
@given(goals=_goals, lag=st.booleans(), samples=st.lists(st.integers(1, STEP), max_size=3),
       value=st.integers(0, 0xFFFFFF))
def test_smooth_motion_gives_the_words_of_the_closed_form(
        goals: list[tuple[float, float]], lag: bool, samples: list[int], value: int) -> None:
    quirks = Quirks(direction_lag=lag)
    encoders, quadrature = Encoders(1, 4, (quirks,)), Quadrature(-DELAY, 0, 0, quirks=quirks)
    x: Floats = np.array((0.25, 0.5, 0.5, 0.5))
    encoders.place(x)
    for number, (move, bend) in enumerate(goals):
        begin = number * STEP
        v, h = np.zeros(4), np.zeros(4)
        v[0], h[0] = (move - bend) / STEP, bend / STEP**2
        encoders.follow(begin, STEP, np.array((x, v, h)))
        end = float(x[0] + v[0] * STEP + h[0] * STEP**2)
        assume(abs(end - round(end)) > 1e-7)  # an edge at the very end belongs to this step or to the next
        edges = crossings(float(x[0]), float(v[0]), float(h[0]))
        assume(all(late - early > DELAY for (early, _), (late, _) in pairwise(edges)))
        assume(not edges or edges[0][0] > DELAY)
        for sample in sorted({*samples, STEP}):
            while edges and edges[0][0] <= sample:
                tick, at = edges.pop(0)
                quadrature.change(begin + tick - DELAY, *((0, 0), *UPWARDS)[at % 4])
            encoders.observe(begin + sample)
            encoders.words(begin + sample)
            assert words(quadrature, begin + sample) == tuple(encoders.shown[0, :, 0].tolist())
        if number == 2:
            encoders.load(np.array([0]), np.array([value]))
            quadrature.load(0, value)
        x = x + v * STEP + h * STEP**2
