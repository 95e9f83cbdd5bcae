"""Pacing on absolute deadlines, the statistics of a loop's periods, work and latency, and pauses.

Deadlines lie on a grid: a late cycle does not shift the following ones, it is counted, and deadlines that have passed
altogether are skipped and counted as missed. What a process does every time it waits for a deadline is in the
native library as well (procs/native/pace.c). A loop that was paused measures for how long, on a clock that counts
suspend as well. Pure but for the control page that the numbers are written to, and that clock.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from fractions import Fraction

import numpy as np

from trocar.procs.native.pace_fields import CYCLES, DEADLINE, KEPT, LOOK, MISSED, OVERRUNS, START, STEP, WANTED, WORDS
from trocar.shm.time.clock import boottime_ns
from trocar.shm.time.control_page import ControlPage

INTERVAL_NS = 1_000_000_000
SHORT_SHARE = 0.05  # of the deadlines missed in SHORT_CHECK_NS: the machine has not enough time for everybody
SHORT_CHECK_NS = 200_000_000
SHORT_CHECKS = 3  # one after the other: not a pause of the machine, and before Linux stops FIFO processes
SHORT_NS = (4_000_000_000, 60_000_000_000)  # so long that counts at first, and at most, where it soon happens again
ROOM = 20_000  # for the figures of a second
QUICKEST_NS = 1_000_000  # between two cycles of a loop with longer periods, however much news there is
GAIN = 0.05
SHARES = 4  # of a period, at most, in which it meets that of whom it follows
NEVER = 1 << 62
FIGURES = ("avg", "std", "min", "max", "p99")


def phase_ns(share: float, period_ns: int, ios_ns: Sequence[int]) -> int:
    """Where in its period a member of simulated time has its turn; `ios_ns` are the periods of io.

    A share of the shortest of all these, so that nobody's turn comes in the very instant of io's, also where the one
    period is a multiple of the other: who comes first there would be left to chance.
    """
    return round(share * min(period_ns, *ios_ns)) if ios_ns else round(share * period_ns)


class Pacing:
    """One loop's deadlines and figures; all times in ns of the process's clock.

    Its counters are in `words`, so that the native library works on the same.
    """

    gain = GAIN

    def __init__(self, page: ControlPage, period_ns: int, phase_ns: int) -> None:
        """`phase_ns` is where on the grid of periods cycles lie in lock-step."""
        self.period_ns, self._phase_ns = max(1, period_ns), phase_ns
        page.field("period_ns")[...] = period_ns
        self._interval = page.field("interval_cycles")
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
        self._beat, self._cycles, self._missed, self._overruns = (
            cell.data for cell in (self.beat, self.cycles, self.missed, self.overruns))
        self._latency_count = self._interval_end = 0
        self._beats = True
        self._short_check = self._short_checks = self._short_ns = self._missed_before = 0
        self.short_until_ns = 0
        """Till then time counts as short: many deadlines were missed of late."""

    def begin(self, now_ns: int, simulated: bool) -> None:
        """Start the grid: at the next phase point in simulated time, now on the wall clock.

        The heartbeat is real time: in simulated time it is not ours to give.
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
        """When this cycle began."""
        return int(self._words[START])

    def follows(self, period_ns: int) -> None:
        """Whom we `follow` has that period: two thirds of ours begin at three places in ours, a third of it apart.

        Any of these will do. Were it one of them, it would matter which of theirs was the newest that we saw.
        """
        shares = Fraction(period_ns, self.period_ns).limit_denominator(SHARES).denominator
        self._words[STEP] = self.period_ns // shares

    def follow(self, wanted_ns: int) -> None:
        """Pull the grid gently at the end of this cycle, so that deadlines fall on `wanted_ns`, or whole steps from
        there: see `follows`.
        """
        self._words[WANTED] = wanted_ns

    def latency(self, latency_ns: int) -> None:
        """What the process calls its latency, of this cycle; a cycle may have none."""
        if self._latency_count < self.room:
            self._latencies[self._latency_count] = latency_ns
            self._latency_count += 1

    def end_of_work(self, now_ns: int, periods: int = 1) -> int:
        """The cycle's work is done; returns the next deadline, so many periods after this cycle's."""
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
        """The next cycle begins now, before its deadline; the one after it on the next point of the grid."""
        self._words[DEADLINE] -= -(-(self._words[DEADLINE] - now_ns) // self.period_ns) * self.period_ns

    def begin_work(self, now_ns: int) -> None:
        """A cycle begins."""
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
        """A cycle begins because who calls us once a period does so now: his deadlines are ours.

        Periods in which he did not call were missed.
        """
        words = self._words
        if words[CYCLES]:
            words[MISSED] += max(0, round((now_ns - words[DEADLINE]) / self.period_ns))
            self._missed[0] = words[MISSED]
        words[DEADLINE] = now_ns
        self.begin_work(now_ns)

    def look(self, now_ns: int) -> None:
        """What is done a few times a second."""
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
            seconds = samples[: max(count, 1)] * (1e-9 if count else 0.0)  # nothing in this second: all 0
            place = min(len(seconds) - 1, int(0.99 * len(seconds)))
            figures = (seconds.mean(), seconds.std(), seconds.min(), seconds.max(), np.partition(seconds, place)[place])
            for cell, figure in zip(self._figures[which], figures, strict=True):
                cell[...] = figure
        self._interval[...] = self._words[KEPT]
        self._words[KEPT] = self._latency_count = 0
        self._interval_end = now_ns + INTERVAL_NS


class Pauses:
    """One loop's watch on itself: how much later than planned its cycles begin, and whether this one is too old."""

    def __init__(self, limit_ns: int, now_ns: Callable[[], int] = boottime_ns) -> None:
        """More than `limit_ns` is a pause; 0: nothing ever is. `now_ns`: CLOCK_BOOTTIME."""
        self._limit_ns, self._now_ns = limit_ns or NEVER, now_ns
        self._begun_ns = NEVER

    def begin(self) -> None:
        """A first cycle begins, on time whenever that is."""
        self._begun_ns = self._now_ns()

    def end(self) -> None:
        """There are no cycles until `begin`: nothing is too old meanwhile."""
        self._begun_ns = NEVER

    def next(self, planned_ns: int) -> int:
        """The next cycle begins, planned so long after the last one: how much too late if that is a pause, else 0.

        After a pause there is no next cycle: `is_over` stays true until `end` or `begin`.
        """
        now_ns = self._now_ns()
        late_ns = now_ns - self._begun_ns - planned_ns  # the first of all is never late
        if late_ns > self._limit_ns:
            return late_ns
        self._begun_ns = now_ns
        return 0

    @property
    def over_ns(self) -> int:
        """From when on, on CLOCK_BOOTTIME, what this cycle does is about the past."""
        return min(self._begun_ns + self._limit_ns, NEVER)

    def is_over(self) -> bool:
        """This cycle began so long ago that what it does is about the past."""
        return self._now_ns() > self.over_ns


def duration(held_up_ns: int) -> str:
    """A pause in words."""
    seconds = held_up_ns * 1e-9
    return f"{seconds:.2g} s" if seconds < 1.0 else f"{seconds:.1f} s"
