"""Counters and overflow bits against the law of the real firmware, transition by transition."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from trocar.procs.boards.controllers.encoder import Encoders
from trocar.procs.boards.controllers.lines import Floats
from trocar.procs.document.system import Quirks
from trocar.procs.fpga import registers as reg

STEP = 49152  # ticks of a millisecond
FAITHFUL = Quirks()


class EncoderCounter:
    """What the real firmware does at each transition and preload."""

    def __init__(self, quirks: Quirks) -> None:
        self.quirks = quirks
        self.power_up()

    def power_up(self) -> None:
        self.counter, self.up, self.overflow = reg.ENCODER_ZERO, False, False

    def edge(self, up: bool) -> None:
        before = self.counter
        direction = self.up if self.quirks.direction_lag else up
        self.counter = (before + (1 if direction else -1)) & 0x1FF_FFFF
        self.overflow |= bool(~before & self.counter & 1 << 24)
        self.up = up

    def load(self, value: int) -> None:
        self.counter = value
        self.overflow &= self.quirks.sticky_overflow

    @property
    def word(self) -> int:
        return self.overflow * reg.ENCODER_OVERFLOW | self.counter & reg.ENCODER_MASK


class EncoderPair:
    """Two boards of the same quirks and one `EncoderCounter` for axis 1 of the second; others stay away from ends."""

    def __init__(self, quirks: Quirks = FAITHFUL) -> None:
        self.encoders = Encoders(2, 4, (Quirks(), quirks))
        self.x: Floats = np.full(8, 0.5)
        self.encoders.place(self.x)
        self.counter = EncoderCounter(quirks)
        self.tick = 0

    def step(self, ends: tuple[float, float], samples: tuple[int, ...] = ()) -> None:
        """One step in which the axis goes to ends[0] in its middle and to ends[1] at its end, as a parabola."""
        x0, middle, end = self.x[5], *ends
        h = 2.0 * (end - 2.0 * middle + x0) / STEP**2
        v = (end - x0) / STEP - h * STEP
        velocity, half = np.full(8, 3.0 / STEP), np.zeros(8)
        velocity[5], half[5] = v, h
        self.encoders.observe(self.tick)
        self.encoders.follow(self.tick, STEP, np.array((self.x, velocity, half)))
        turn = -v / (2.0 * h) if h else -1.0
        stops = {float(sample): True for sample in samples} | {float(STEP): False}
        if 0.0 < turn < STEP:
            stops.setdefault(turn, False)
        at = math.floor(x0)
        for tau in sorted(stops):
            now = math.floor(x0 + (v + h * tau) * tau)
            for _ in range(abs(now - at)):
                self.counter.edge(now > at)
            at = now
            if stops[tau]:
                assert self.word(self.tick + int(tau)) == self.counter.word, f"{tau} ticks into the step"
        self.x = self.x + velocity * STEP + half * STEP**2
        self.x[5] = x0 + (v + h * STEP) * STEP
        self.tick += STEP
        self.encoders.observe(self.tick)

    def word(self, tick: int) -> int:
        self.encoders.observe(tick)
        self.encoders.words(tick)
        return int(self.encoders.shown[1, 0, 1]) & (reg.ENCODER_OVERFLOW | reg.ENCODER_MASK)

    def load(self, value: int) -> None:
        self.encoders.load(np.array([5]), np.array([value]))
        self.counter.load(value)

    def power_up(self) -> None:
        self.encoders.power_up(1)
        self.counter.power_up()


_away = st.floats(-12.0, 12.0).map(lambda x: round(x, 3) + 0.0004)  # never on a whole number
_steps = st.tuples(st.just("step"), st.tuples(_away, _away), st.lists(st.integers(1, STEP), max_size=2))
_loads = st.tuples(st.just("load"), st.one_of(st.integers(0, 5), st.integers(0xFFFFFA, 0xFFFFFF),
                                              st.integers(0x7FFFF0, 0x800010)))
_deeds = st.lists(st.one_of(_steps, _steps, _loads, st.tuples(st.just("power up"))), min_size=1, max_size=14)


@examples(100)
@given(lag=st.booleans(), sticky=st.booleans(), first=_loads, deeds=_deeds)
def test_counters_follow_the_law_of_transitions(
        lag: bool, sticky: bool, first: tuple[object, ...], deeds: list[tuple[object, ...]]) -> None:
    pair = EncoderPair(Quirks(direction_lag=lag, sticky_overflow=sticky))
    for deed in (first, *deeds):
        match deed:
            case ("step", (float(middle), float(end)), list(samples)):
                pair.step((middle, end), tuple(samples))
            case ("load", int(value)):
                pair.load(value)
            case _:
                pair.power_up()
        # Looking changes what is remembered; so only every other kind of deed is followed by a look.
        if deed[0] != "step":
            assert pair.word(pair.tick) == pair.counter.word
    assert pair.word(pair.tick) == pair.counter.word


def test_overflow_at_the_highest_speed_shows_at_once() -> None:
    pair = EncoderPair()
    pair.load(5000)
    pair.step((-4999.75, -10000.0004), samples=(24_000, 25_500))  # nearly as fast as the filter lets edges through
    assert pair.counter.overflow


@pytest.mark.parametrize("sticky", [True, False])
def test_preload_clears_overflow_where_the_quirk_is_off(sticky: bool) -> None:
    pair = EncoderPair(Quirks(sticky_overflow=sticky))
    pair.load(0)
    pair.step((-2.5, -4.5))
    assert pair.word(pair.tick) & reg.ENCODER_OVERFLOW
    pair.load(0x800000)
    assert pair.word(pair.tick) == (reg.ENCODER_OVERFLOW if sticky else 0) | 0x800000
    pair.power_up()
    assert pair.word(pair.tick) == 0x800000


def test_power_up_leaves_no_trace_of_edges_and_other_boards_alone() -> None:
    pair = EncoderPair()
    for _ in range(4):
        pair.step((3.5, 6.5))
        pair.step((3.5, 0.5))
    pair.load(0x123456)
    words = pair.encoders.shown
    pair.encoders.words(pair.tick)
    others = words[0].copy()
    pair.encoders.power_up(1)
    pair.encoders.words(pair.tick)
    assert (words[1, 0] & 0x1FF_FFFF).tolist() == [0x800000] * 4
    assert words[1, 1:].tolist() == [[0xCBFFFFFF] * 4, [0x43FFFFFF] * 4, [0x43FFFFFF] * 4, [0x83FFFFFF] * 4]
    assert pair.encoders.preload[4:].tolist() == [0x800000] * 4
    assert (words[0] == others).all()


def test_quirks_must_be_given_for_every_board_or_none() -> None:
    with pytest.raises(ValueError, match="quirks of 1 boards; there are 2"):
        Encoders(2, 4, (Quirks(),))
