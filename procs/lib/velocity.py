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
    """Counts/s and counts/s² from period, quarter 1, quarter 5 and running words.

    Magnitudes are worked on without a sign, so that a prediction that would change sign stops at zero.
    """

    def __init__(self, n: int, clock_hz: float = float(registers.CLOCK_HZ)) -> None:
        """`clock_hz` is the tick rate of the boards."""
        self.velocity: Floats = np.zeros(n)  # counts/s over the last four edges
        self.acceleration: Floats = np.zeros(n)  # counts/s²
        self.predicted: Floats = np.zeros(n)  # counts/s at the time of the sample
        self._words = np.zeros((4, n), dtype=np.uint32)
        self._ticks_mask = np.full((4, n), registers.VELOCITY_TICKS_MASK, dtype=np.uint32)
        self._ticks = np.zeros((4, n))
        self._least = np.array([[1.0], [0.0], [0.0], [_NEVER]]) + np.zeros((4, n))
        self._shift = np.full(n, 29, dtype=np.uint32)
        self._kind = np.zeros(n, dtype=np.uint32)
        # by the top three bits of the period word: overflow, direction, direction changed
        self._signs = np.array([-1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        self._sign = np.zeros(n)
        self._edges = np.zeros((2, n), dtype=np.uint32)
        self._edge_mask = np.array([[_SAME_EDGE], [registers.VELOCITY_DIRECTION]], dtype=np.uint32) + np.zeros(
            (2, n), dtype=np.uint32)
        self._comparable = np.zeros(n, dtype=bool)
        self._long = np.zeros(n, dtype=bool)
        self._saturated = np.zeros(n, dtype=bool)
        self._zero = np.zeros(n, dtype=np.uint32)
        self._threshold = np.full(n, 1.0 / ACCELERATION_THRESHOLD)
        self._smallest = np.full(n, 1.0)
        self._overflow = np.full(n, registers.VELOCITY_OVERFLOW, dtype=np.uint32)
        self._largest = np.full(n, float(registers.VELOCITY_TICKS_MASK))
        self._four_hz, self._clock = np.full(n, 4.0 * clock_hz), np.full(n, clock_hz)
        self._eight_hz2 = np.full(n, 8.0 * clock_hz * clock_hz)
        self._half_tick, self._tick = np.full(n, 0.5 / clock_hz), np.full(n, 1.0 / clock_hz)
        self._a, self._b, self._c = np.zeros(n), np.zeros(n), np.zeros(n)
        self._none = np.zeros(n)

    def update(self, words: Words) -> Floats:
        """Estimate from `words` (4, n): period, quarter 5, quarter 1, running. Returns `predicted`."""
        np.bitwise_and(words, self._ticks_mask, self._words)
        ticks = self._ticks
        ticks[...] = self._words
        np.maximum(ticks, self._least, out=ticks)
        period, quarter5, quarter1, running = ticks
        np.right_shift(words[0], self._shift, self._kind)
        self._signs.take(self._kind, out=self._sign, mode="clip")
        speed = np.divide(self._four_hz, period, self.velocity)
        self._acceleration(words, period, quarter1, quarter5)
        # half the period back to the middle of the four edges, and the time since the last one
        since, step, cap = self._a, self._b, self._c
        np.multiply(period, self._half_tick, since)
        np.multiply(running, self._tick, step)
        np.add(since, step, since)
        np.multiply(self.acceleration, since, step)
        np.add(step, speed, step)
        np.divide(self._clock, running, cap)
        np.minimum(step, cap, out=step)
        np.maximum(step, self._none, out=step)
        np.multiply(step, self._sign, self.predicted)
        np.multiply(speed, self._sign, self.velocity)
        np.multiply(self.acceleration, self._sign, self.acceleration)
        return self.predicted

    def _acceleration(self, words: Words, period: Floats, quarter1: Floats, quarter5: Floats) -> None:
        """Magnitude of the acceleration along the direction of motion; zero where the edges do not compare."""
        edges = np.bitwise_xor(words[1::-1], words[2], self._edges)  # quarter 5, then period, against quarter 1
        np.bitwise_and(edges, self._edge_mask, edges)
        np.bitwise_or(edges[0], edges[1], edges[0])
        np.equal(edges[0], self._zero, self._comparable)
        np.greater_equal(quarter1, self._threshold, self._long)
        np.logical_and(self._comparable, self._long, self._comparable)
        np.greater_equal(quarter5, self._smallest, self._long)
        np.logical_and(self._comparable, self._long, self._comparable)
        change, before, both = self._a, self._b, self._c
        np.subtract(quarter5, quarter1, change)
        np.add(period, change, before)
        np.greater_equal(words[1], self._overflow, self._saturated)
        np.putmask(before, self._saturated, self._largest)
        np.maximum(before, self._smallest, out=before)
        np.add(quarter5, quarter1, both)
        np.maximum(both, self._smallest, out=both)
        np.multiply(before, period, before)
        np.multiply(before, both, before)
        np.divide(change, before, change)
        np.multiply(change, self._eight_hz2, change)
        np.multiply(change, self._comparable, self.acceleration)


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
