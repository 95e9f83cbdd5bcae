"""Pacing on absolute deadlines; statistics of a loop's periods, work and latency; detection of pauses.

Deadlines are points of a grid: a late cycle is counted and does not shift the following ones; deadlines that have
passed are skipped and counted as missed. The native library implements the wait for a deadline as well
(procs/native/pace.c). A loop measures the length of a pause on a clock that includes suspend. No side effects except
on the control page that gets the numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction
from typing import Final

import numpy as np

from trocar.procs.native.pace_fields import CYCLES, DEADLINE, KEPT, LOOK, MISSED, OVERRUNS, START, STEP, WANTED, WORDS
from trocar.shm.time.clock import boottime_ns
from trocar.shm.time.control_page import ControlPage

INTERVAL_NS = 1_000_000_000
SHORT_SHARE = 0.05  # of the deadlines missed in SHORT_CHECK_NS: the machine is overloaded
SHORT_CHECK_NS = 200_000_000
SHORT_CHECKS = 3  # in a row: excludes a pause of the machine, and comes before Linux stops FIFO processes
SHORT_NS = (4_000_000_000, 60_000_000_000)  # duration of the overload state at first, and at most if it soon recurs
ROOM = 20_000  # samples for the statistics of a second
AFTER_OTHERS_NS: Final = 1
"""In simulated time, a process that was woken begins its cycle after the cycles of others at that instant: their order
would not be the same each time.
"""
QUICKEST_NS = 1_000_000
GAIN = 0.05
SHARES = 4  # of a period, at most: largest denominator of the ratio of the followed period to it
NEVER = 1 << 62
FIGURES = ("avg", "std", "min", "max", "p99")


def phase_ns(share: float, period_ns: int, ios_ns: Sequence[int]) -> int:
    """The phase of a lock-step member within its period; `ios_ns` are the periods of io.

    It is a share of the shortest of all these periods, so that no member runs at the same instant as io, even if one
    period is a multiple of the other: their order would be left to chance.
    """
    return round(share * min(period_ns, *ios_ns)) if ios_ns else round(share * period_ns)


class Pacing:
    """One loop's deadlines and statistics; all times in ns of the process's clock.

    Its counters are in `words`, which it shares with the native library.
    """

    gain = GAIN

    def __init__(self, page: ControlPage, period_ns: int, phase_ns: int) -> None:
        """`phase_ns`: offset of the cycles from the grid of periods in lock-step."""
        self.period_ns, self._phase_ns = max(1, period_ns), phase_ns
        self.quickest_ns = min(QUICKEST_NS, self.period_ns)
        """Minimum time between two cycles, even with much news."""
        page.field("period_ns")[...] = period_ns
        self._interval, self._interval_missed = page.field("interval_cycles"), page.field("interval_missed")
        self._figures = {
            which: [page.field(f"{which}_{figure}") for figure in FIGURES] for which in ("period", "work", "latency")
        }
        self.room = min(ROOM, 2 * INTERVAL_NS // min(self.period_ns, QUICKEST_NS))
        self.periods, self.work, self._latencies = (np.zeros(self.room) for _ in range(3))
        self._period_at, self._work_at = self.periods.data, self.work.data
        self.words = np.zeros(WORDS, np.int64)
        self._words = self.words.data
        self._words[STEP] = self.period_ns
        self.beat, self.cycles, self.missed, self.overruns = (
            page.field(name).reshape(1) for name in ("heartbeat_ns", "cycles", "missed", "overruns"))
        self.wakeup = page.field("wakeup").reshape(1)
        self._beat, self._cycles, self._missed, self._overruns = (
            cell.data for cell in (self.beat, self.cycles, self.missed, self.overruns))
        self._latency_count = self._interval_end = 0
        self._beats = True
        self._short_check = self._short_checks = self._short_ns = self._missed_before = self._missed_then = 0
        self.short_until_ns = 0
        """End of the overload state, entered when many deadlines were missed."""

    def begin(self, now_ns: int, simulated: bool) -> None:
        """Start the grid: at the next phase point in simulated time, now on the wall clock.

        The heartbeat is real time; in simulated time it is not updated here.
        """
        self._beats = not simulated
        deadline = now_ns
        if simulated:
            deadline = now_ns - now_ns % self.period_ns + self._phase_ns
            if deadline <= now_ns:
                deadline += self.period_ns
            deadline -= self.period_ns  # end_of_work adds one
        words = self._words
        words[START], words[DEADLINE], words[WANTED] = now_ns, deadline, 0
        self._interval_end = now_ns + INTERVAL_NS
        words[LOOK] = min(self._interval_end, self._short_check)
        if self._beats:
            self._beat[0] = now_ns

    @property
    def begun_ns(self) -> int:
        """Begin of this cycle."""
        return int(self._words[START])

    def follows(self, period_ns: int) -> None:
        """Set the period of the process to `follow`. If it is 2/3 of ours, its cycles begin at three phases of ours.

        They are 1/3 of our period apart, and any of them will do: with a fixed one, the alignment would depend on
        which of its cycles we saw last.
        """
        shares = Fraction(period_ns, self.period_ns).limit_denominator(SHARES).denominator
        self._words[STEP] = self.period_ns // shares

    def follow(self, wanted_ns: int) -> None:
        """Shift the grid gently at the end of this cycle, towards deadlines at `wanted_ns` plus whole steps
        (see `follows`).
        """
        self._words[WANTED] = wanted_ns

    def latency(self, latency_ns: int) -> None:
        """Record the latency of this cycle, as the process defines it; optional."""
        if self._latency_count < self.room:
            self._latencies[self._latency_count] = latency_ns
            self._latency_count += 1

    def end_of_work(self, now_ns: int, periods: int = 1) -> int:
        """End the cycle's work; returns the next deadline, `periods` after this cycle's."""
        words, period = self._words, self.period_ns
        deadline, work = words[DEADLINE], now_ns - words[START]
        if wanted := words[WANTED]:
            step, words[WANTED] = words[STEP], 0
            error = (wanted - deadline) % step
            deadline += int((error - step if error > step // 2 else error) * self.gain)
        if words[KEPT] < self.room:
            self._work_at[words[KEPT]] = work
        if work > period:
            words[OVERRUNS] += 1
            self._overruns[0] = words[OVERRUNS]
        deadline += period * periods
        if now_ns > deadline:
            skipped = (now_ns - deadline) // period + 1
            words[MISSED] += skipped
            self._missed[0] = words[MISSED]
            deadline += (skipped - 1) * period
        words[DEADLINE] = deadline
        return int(deadline)

    def early(self, now_ns: int) -> None:
        """Begin the next cycle now, before its deadline; the one after it begins at the next point of the grid."""
        self._words[DEADLINE] -= -(-(self._words[DEADLINE] - now_ns) // self.period_ns) * self.period_ns

    def begin_work(self, now_ns: int) -> None:
        """Begin a cycle."""
        words = self._words
        if words[KEPT] < self.room:
            self._period_at[words[KEPT]] = now_ns - words[START]
            words[KEPT] += 1
        words[START] = now_ns
        words[CYCLES] += 1
        self._cycles[0] = words[CYCLES]
        if self._beats:
            self._beat[0] = now_ns
        if now_ns >= words[LOOK]:
            self.look(now_ns)

    def called(self, now_ns: int) -> None:
        """Begin a cycle of a process that its host calls once a period, with the host's deadlines.

        Periods without a call count as missed.
        """
        words = self._words
        if words[CYCLES]:
            words[MISSED] += max(0, round((now_ns - words[DEADLINE]) / self.period_ns))
            self._missed[0] = words[MISSED]
        words[DEADLINE] = now_ns
        self.begin_work(now_ns)

    def look(self, now_ns: int) -> None:
        """Check for overload and publish statistics, when due."""
        if now_ns >= self._short_check:
            self._look_at_missed(now_ns)
        if now_ns >= self._interval_end:
            self._publish(now_ns)
        self._words[LOOK] = min(self._interval_end, self._short_check)

    def _look_at_missed(self, now_ns: int) -> None:
        missed = self._words[MISSED]
        much = (missed - self._missed_before) * self.period_ns > SHORT_SHARE * SHORT_CHECK_NS
        self._short_checks = self._short_checks + 1 if much else 0
        if self._short_checks >= SHORT_CHECKS:
            if (since := now_ns - self.short_until_ns) >= 0:
                self._short_ns = min(2 * self._short_ns, SHORT_NS[1]) if since < self._short_ns else SHORT_NS[0]
            self.short_until_ns = now_ns + self._short_ns
        self._missed_before = missed
        self._short_check = now_ns + SHORT_CHECK_NS

    def _publish(self, now_ns: int) -> None:
        count = self._words[KEPT]
        kept = (("period", self.periods, count), ("work", self.work, count),
                ("latency", self._latencies, self._latency_count))
        for which, samples, count in kept:
            seconds = samples[: max(count, 1)] * (1e-9 if count else 0.0)  # no samples in this second: all 0
            place = min(len(seconds) - 1, int(0.99 * len(seconds)))
            figures = (seconds.mean(), seconds.std(), seconds.min(), seconds.max(), np.partition(seconds, place)[place])
            for cell, figure in zip(self._figures[which], figures, strict=True):
                cell[...] = figure
        self._interval[...] = self._words[KEPT]
        self._interval_missed[...] = self._words[MISSED] - self._missed_then
        self._missed_then = self._words[MISSED]
        self._words[KEPT] = self._latency_count = 0
        self._interval_end = now_ns + INTERVAL_NS


class Pauses:
    """Detects pauses of a loop: cycles that begin too late, or have lasted too long."""

    def __init__(self, limit_ns: int, now_ns: Callable[[], int] = boottime_ns) -> None:
        """A delay above `limit_ns` is a pause; 0 disables the check. `now_ns` reads CLOCK_BOOTTIME."""
        self._limit_ns, self._now_ns = limit_ns or NEVER, now_ns
        self._begun_ns = NEVER

    def begin(self) -> None:
        """Begin a first cycle, which is on time by definition."""
        self._begun_ns = self._now_ns()

    def end(self) -> None:
        """Suspend the check until `begin`."""
        self._begun_ns = NEVER

    def next(self, planned_ns: int) -> int:
        """Begin the next cycle, planned `planned_ns` after the last; returns its delay if that is a pause, else 0.

        After a pause no cycle begins: `is_over` stays true until `end` or `begin`.
        """
        now_ns = self._now_ns()
        late_ns = now_ns - self._begun_ns - planned_ns  # the first cycle is never late
        if late_ns > self._limit_ns:
            return late_ns
        self._begun_ns = now_ns
        return 0

    @property
    def over_ns(self) -> int:
        """The time on CLOCK_BOOTTIME after which this cycle's results are outdated."""
        return min(self._begun_ns + self._limit_ns, NEVER)

    def is_over(self) -> bool:
        """Whether this cycle began so long ago that its results are outdated."""
        return self._now_ns() > self.over_ns


def duration(held_up_ns: int) -> str:
    """A pause in words."""
    seconds = held_up_ns * 1e-9
    return f"{seconds:.2g} s" if seconds < 1.0 else f"{seconds:.1f} s"
