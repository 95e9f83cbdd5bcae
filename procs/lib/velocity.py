"""Velocity of encoders, two ways: from the edge timing the firmware measures, and from count differences.

`FirmwareVelocity` works on the raw words of a real-time block, `SoftwareVelocity` on counts and the boards' time
between samples; both are vectorised over n actuators and allocate nothing in `update`.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from procs.lib import registers

Floats = NDArray[np.float64]
Words = NDArray[np.uint32]

ACCELERATION_THRESHOLD: Final = 0.0005  # 1 / newest quarter period [ticks]: with fewer ticks, time is too coarse
SLOWEST_S: Final = 1.0  # the software estimate runs out to zero in this time without a count

_SAME_EDGE: Final = registers.VELOCITY_DIRECTION | 0xF << registers.QUARTER_EDGE_SHIFT
_NEVER: Final = 1e-300  # stands for 0 ticks where a division needs something


class FirmwareVelocity:
    """Counts/s and counts/s² from period, quarter 5, quarter 1 and running words.

    A caller fills `words` (4, n), in that order, and calls `update`. Magnitudes are worked on without a sign, so that a
    prediction that would change sign stops at zero.
    """

    def __init__(self, n: int, clock_hz: float | Floats = float(registers.CLOCK_HZ)) -> None:
        """`clock_hz` is the tick rate of the boards, of all or (n,) of each."""
        self.words: Words = np.zeros((4, n), dtype=np.uint32)
        self.predicted: Floats = np.zeros(n)  # counts/s at the time of the sample
        self._speed, self._rate, self._sign = np.zeros(n), np.zeros(n), np.zeros(n)
        self._period_word, self._quarter5_word, self._quarter1_word, _ = self.words
        self._masked = np.zeros((4, n), dtype=np.uint32)
        self._ticks_mask = np.full((4, n), registers.VELOCITY_TICKS_MASK, dtype=np.uint32)
        self._ticks = np.zeros((4, n))
        self._period, self._quarter5, self._quarter1, self._running = self._ticks
        self._least = np.array([[1.0], [0.0], [0.0], [_NEVER]]) + np.zeros((4, n))
        self._shift = np.full(n, 29, dtype=np.uint32)
        self._kind = np.zeros(n, dtype=np.uint32)
        # by the top three bits of the period word: overflow, direction, direction changed
        self._signs = np.array([-1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        self._edges, self._turns = np.zeros(n, dtype=np.uint32), np.zeros(n, dtype=np.uint32)
        self._edge_mask = np.full(n, _SAME_EDGE, dtype=np.uint32)
        self._turn_mask = np.full(n, registers.VELOCITY_DIRECTION, dtype=np.uint32)
        self._apart, self._short = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
        self._no_bits = np.zeros(n, dtype=np.uint32)
        self._threshold = np.full(n, 1.0 / ACCELERATION_THRESHOLD)
        self._smallest = np.full(n, 1.0)
        self._overflow = np.full(n, registers.VELOCITY_OVERFLOW, dtype=np.uint32)
        self._largest = np.full(n, float(registers.VELOCITY_TICKS_MASK))
        self._four_hz, self._clock = np.full(n, 4.0 * clock_hz), np.full(n, clock_hz)
        self._eight_hz2 = np.full(n, 8.0 * clock_hz * clock_hz)
        self._half_period, self._tick = np.full(n, 0.5), np.full(n, 1.0 / np.asarray(clock_hz))
        self._a, self._b = np.zeros(n), np.zeros(n)
        self._none = np.zeros(n)

    @property
    def velocity(self) -> Floats:
        """Counts/s over the last four edges."""
        return self._speed * self._sign

    @property
    def acceleration(self) -> Floats:
        """Counts/s²."""
        return self.accelerations(np.zeros_like(self._rate))

    def accelerations(self, out: Floats) -> Floats:
        """Counts/s² into `out`."""
        return np.multiply(self._rate, self._sign, out)

    def update(self) -> Floats:
        """Estimate from `words`; returns `predicted`."""
        ticks, period, running = self._ticks, self._period, self._running
        np.bitwise_and(self.words, self._ticks_mask, self._masked)
        ticks[...] = self._masked
        np.maximum(ticks, self._least, out=ticks)
        np.right_shift(self._period_word, self._shift, self._kind)
        self._signs.take(self._kind, out=self._sign, mode="clip")
        speed = np.divide(self._four_hz, period, self._speed)
        self._accelerate()
        # half the period back to the middle of the four edges, and the time since the last one
        since, cap = self._a, self._b
        np.multiply(period, self._half_period, since)
        np.add(since, running, since)
        np.multiply(since, self._tick, since)
        np.multiply(self._rate, since, since)
        np.add(since, speed, since)
        np.divide(self._clock, running, cap)
        np.minimum(since, cap, out=since)
        np.maximum(since, self._none, out=since)
        return np.multiply(since, self._sign, self.predicted)

    def _accelerate(self) -> None:
        """Magnitude of the acceleration along the direction of motion; zero where the edges do not compare."""
        edges, turns, apart, short = self._edges, self._turns, self._apart, self._short
        quarter1, quarter5 = self._quarter1, self._quarter5
        np.bitwise_xor(self._quarter5_word, self._quarter1_word, edges)
        np.bitwise_and(edges, self._edge_mask, edges)
        np.bitwise_xor(self._period_word, self._quarter1_word, turns)
        np.bitwise_and(turns, self._turn_mask, turns)
        np.bitwise_or(edges, turns, edges)
        np.not_equal(edges, self._no_bits, apart)
        np.less(quarter1, self._threshold, short)
        np.bitwise_or(apart, short, apart)
        np.less(quarter5, self._smallest, short)
        np.bitwise_or(apart, short, apart)
        change, before, both = self._rate, self._a, self._b
        np.subtract(quarter5, quarter1, change)
        np.add(self._period, change, before)
        np.greater_equal(self._quarter5_word, self._overflow, short)
        np.putmask(before, short, self._largest)
        np.add(quarter5, quarter1, both)
        np.multiply(before, both, before)
        np.multiply(before, self._period, before)
        np.putmask(before, apart, self._smallest)  # also where there would be nothing to divide by
        np.divide(change, before, change)
        np.multiply(change, self._eight_hz2, change)
        np.putmask(change, apart, self._none)


class SoftwareVelocity:
    """Counts/s from count differences: the last jump over the time it took, then a slope down to zero."""

    def __init__(self, n: int) -> None:
        """Nothing known yet: the first update gives 0."""
        self.velocity: Floats = np.zeros(n)
        self._previous = np.zeros(n)
        self._since, self._slope = np.zeros(n), np.zeros(n)
        self._change, self._magnitude = np.zeros(n), np.zeros(n)
        self._a, self._b = np.zeros(n), np.zeros(n)
        self._moved, self._young = np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
        self._none, self._one, self._slowest = np.zeros(n), np.ones(n), np.full(n, SLOWEST_S)
        self._known = False

    def reset(self, counts: NDArray[np.generic]) -> None:
        """The counters were set: what they show now is no motion."""
        np.copyto(self._previous, counts)
        for each in (self._since, self._slope, self.velocity):
            each.fill(0.0)
        self._known = True

    def update(self, counts: NDArray[np.generic], dt: Floats) -> Floats:
        """Estimate from `counts` (n,) and the boards' time since the sample before, `dt` (n,) in s."""
        if not self._known:
            self.reset(counts)
            return self.velocity
        change, v = self._change, self.velocity
        np.subtract(counts, self._previous, change)
        np.copyto(self._previous, counts)
        # no count: run down the slope for a second, then stand still
        np.less(self._since, self._slowest, self._young)
        np.multiply(self._slope, dt, self._a)
        np.subtract(v, self._a, v)
        np.multiply(v, self._young, v)
        np.add(self._since, dt, self._since)
        np.not_equal(change, self._none, self._moved)
        if b"\1" not in self._moved.tobytes():
            return v
        # counts: one of them took all the time since the last, the others fell into this interval
        jump, tiny = self._b, _NEVER
        np.absolute(change, self._magnitude)
        np.subtract(self._magnitude, self._one, jump)
        np.divide(jump, np.maximum(dt, tiny), jump)
        np.divide(self._one, np.maximum(self._since, tiny, out=self._a), self._a)
        np.add(jump, self._a, jump)
        np.copysign(jump, change, jump)
        np.copyto(v, jump, where=self._moved)
        np.copyto(self._slope, v, where=self._moved)
        np.copyto(self._since, self._none, where=self._moved)
        return v
