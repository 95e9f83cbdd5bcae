"""Velocity of encoders, two ways: from the edge timing the firmware measures, and from count differences.

`FirmwareVelocity` works on the raw words of a real-time block, `SoftwareVelocity` on counts and the boards' time
between samples; both are vectorised over n actuators and allocate nothing in `update`.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.fpga import registers

Floats = NDArray[np.float64]
Words = NDArray[np.uint32]


_NEVER: Final = 1e-300  # replaces 0 ticks in divisions


class FirmwareVelocity:
    """Counts/s and counts/s² from running, period, quarter 5 and quarter 1 words.

    A caller fills `words` (4, n), in that order, and calls `update`. Magnitudes are computed without sign, so that a
    prediction that would change sign stops at zero.

        v = 4 / period                                         over the last four edges, in the middle of them
        a = 8 (q5 − q1) / (period · (period + q5 − q1) · (q5 + q1))
        predicted = v + a · (period / 2 + running), at most one count in the running time
    """

    def __init__(self, n: int, clock_hz: float | Floats = float(registers.CLOCK_HZ)) -> None:
        """`clock_hz` is the tick rate of the boards, common or (n,) for each."""
        # Quarter 1 is stored twice, to be compared with the two previous rows at once: operands of one shape in
        # contiguous memory take a third of the time.
        rows: Words = np.zeros((5, n), dtype=np.uint32)
        self.words: Words = rows[:4]
        self.predicted: Floats = np.zeros(n)  # counts/s at the time of the sample
        hz: Floats = np.asarray(clock_hz) + np.zeros(n)
        # per n: largest possible speed since the last edge, and speed [counts/s]
        self._speeds = np.zeros((2, n))
        self._cap, self._speed = self._speeds
        self._edges_hz = np.array([hz, 4.0 * hz])
        self.hz = hz
        self.rate, self.sign = np.zeros(n), np.zeros(n)  # acceleration [counts/tick² / 8]
        self._rate_scale = 8.0 * hz * hz
        _, self._period_word, self._quarter5_word, self._quarter1_word, self._quarter1_again = rows
        self._compared, self._with = rows[1:3], rows[3:]  # period and quarter 5 with quarter 1
        self._masked = np.zeros((4, n), dtype=np.uint32)
        self._ticks_mask = np.full((4, n), registers.VELOCITY_TICKS_MASK, dtype=np.uint32)
        self._ticks = np.zeros((4, n))
        _, self._period, self._quarter5, self._quarter1 = self._ticks
        self._since_middle, self._quarters = self._ticks[:2], self._ticks[2:]
        self._least = np.array([[_NEVER], [1.0], [_NEVER], [_NEVER]]) + np.zeros((4, n))
        self._shift = np.full(n, 29, dtype=np.uint32)
        self._kind = np.zeros(n, dtype=np.uint32)
        # by the top three bits of the period word: overflow, direction, direction changed
        self._signs = np.array([-1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0])
        self._unlike = np.zeros((2, n), dtype=np.uint32)
        same = np.array([[registers.VELOCITY_DIRECTION], [registers.SAME_EDGE]], np.uint32)
        self._same = same | np.zeros((2, n), np.uint32)
        self._no_bits = np.zeros((2, n), dtype=np.uint32)
        reasons = np.zeros((4, n), dtype=bool)  # why edges are not comparable
        self._apart, self._short = reasons[:2], reasons[2:]
        self._incomparable, self._or_this = self._apart
        self._shortest = np.array([[1.0], [registers.MIN_QUARTER]]) + np.zeros((2, n))
        self._overflow = np.full(n, registers.VELOCITY_OVERFLOW, dtype=np.uint32)
        self._overflowed = np.zeros(n, dtype=bool)
        self._largest = np.full(n, float(registers.VELOCITY_TICKS_MASK))
        self._ages = np.zeros((2, n))  # running time and half the period, times 8 / tick²
        self._whole, self._half = self._ages
        self._age_scale = np.array([8.0 * hz, 4.0 * hz])
        self._a, self._b = np.zeros(n), np.zeros(n)
        self._none = np.zeros(n)

    def accelerations(self, out: Floats) -> Floats:
        """Counts/s² into `out`."""
        np.multiply(self.rate, self.sign, out)
        return np.multiply(out, self._rate_scale, out)

    def update(self) -> Floats:
        """Estimate from `words`; returns `predicted`."""
        ticks = self._ticks
        np.bitwise_and(self.words, self._ticks_mask, self._masked)
        ticks[...] = self._masked
        np.maximum(ticks, self._least, out=ticks)
        np.right_shift(self._period_word, self._shift, self._kind)
        self._signs.take(self._kind, out=self.sign, mode="clip")
        np.divide(self._edges_hz, self._since_middle, self._speeds)
        self._accelerate()
        # half the period back to the middle of the four edges, and the time since the last one
        now = self._a
        np.multiply(self._since_middle, self._age_scale, self._ages)
        np.add(self._half, self._whole, now)
        np.multiply(self.rate, now, now)
        np.add(now, self._speed, now)
        np.minimum(now, self._cap, out=now)
        np.maximum(now, self._none, out=now)
        return np.multiply(now, self.sign, self.predicted)

    def _accelerate(self) -> None:
        """Magnitude of the acceleration along the direction of motion; zero where the edges are not comparable."""
        self._quarter1_again[...] = self._quarter1_word
        np.bitwise_xor(self._compared, self._with, self._unlike)
        np.bitwise_and(self._unlike, self._same, self._unlike)
        np.not_equal(self._unlike, self._no_bits, self._apart)
        np.less(self._quarters, self._shortest, self._short)
        np.bitwise_or(self._apart, self._short, self._apart)
        np.bitwise_or(self._incomparable, self._or_this, self._incomparable)
        change, before, both = self.rate, self._a, self._b
        np.subtract(self._quarter5, self._quarter1, change)
        np.add(self._period, change, before)
        np.greater_equal(self._quarter5_word, self._overflow, self._overflowed)
        np.putmask(before, self._overflowed, self._largest)
        np.add(self._quarter5, self._quarter1, both)
        np.multiply(before, both, before)
        np.multiply(before, self._period, before)
        np.divide(change, before, change)
        np.putmask(change, self._incomparable, self._none)


class SoftwareVelocity:
    """Counts/s from count differences: the last jump over the time it took, then a slope down to zero."""

    def __init__(self, n: int) -> None:
        """No sample yet: the first update gives 0."""
        self.velocity: Floats = np.zeros(n)
        self.previous = np.zeros(n)
        self.since, self.slope = np.zeros(n), np.zeros(n)
        self.known = np.zeros(1, dtype=bool)  # the previous update's counts are valid

    def forget(self) -> None:
        """The counters were set to unknown values: the next update gives 0."""
        self.known[0] = False

    def reset(self, counts: NDArray[np.generic]) -> None:
        """The counters were set: their change is not motion."""
        np.copyto(self.previous, counts)
        for each in (self.since, self.slope, self.velocity):
            each.fill(0.0)
        self.known[0] = True

    def update(self, counts: NDArray[np.generic], dt: Floats) -> Floats:
        """Estimate from `counts` (n,) and the boards' time since the previous sample, `dt` (n,) in s."""
        if not self.known[0]:
            self.reset(counts)
            return self.velocity
        change, v = np.subtract(counts, self.previous), self.velocity
        np.copyto(self.previous, counts)
        # no count: run down the slope for a second, then 0
        np.multiply(v - self.slope * dt, self.since < registers.SLOWEST_S, v)
        self.since += dt
        moved = change != 0.0
        if moved.any():
            # counts: one of them took all the time since the last, the others fell into this interval
            jump = (np.absolute(change) - 1.0) / np.maximum(dt, _NEVER) + 1.0 / np.maximum(self.since, _NEVER)
            np.copyto(v, np.copysign(jump, change), where=moved)
            np.copyto(self.slope, v, where=moved)
            self.since[moved] = 0.0
        return v
