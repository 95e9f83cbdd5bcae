"""Pacing on absolute deadlines, and the statistics of a loop's periods, work and latency.

Deadlines lie on a grid: a late cycle does not shift the following ones, it is counted, and deadlines that have passed
altogether are skipped and counted as missed. Pure but for the control page it writes its numbers to.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import numpy as np

from shm.control_page import ControlPage

INTERVAL_NS = 1_000_000_000
SHORT_SHARE = 0.05  # of the deadlines missed in SHORT_CHECK_NS: the machine has not enough time for everybody
SHORT_CHECK_NS = 200_000_000
SHORT_CHECKS = 3  # one after the other: not a pause of the machine, and before Linux stops FIFO processes
SHORT_NS = (4_000_000_000, 60_000_000_000)  # so long that counts at first, and at most, where it soon happens again
ROOM = 20_000  # for the figures of a second
QUICKEST_NS = 1_000_000  # between two cycles of a loop with longer periods, however much news there is
GAIN = 0.05
SHARES = 4  # of a period, at most, in which it meets that of whom it follows
FIGURES = ("avg", "std", "min", "max", "p99")


def phase_ns(share: float, period_ns: int, ios_ns: Sequence[int]) -> int:
    """Where in its period a member of simulated time has its turn; `ios_ns` are the periods of io.

    A share of the shortest of all these, so that nobody's turn comes in the very instant of io's, also where the one
    period is a multiple of the other: who comes first there would be left to chance.
    """
    return round(share * min(period_ns, *ios_ns)) if ios_ns else round(share * period_ns)


class Pacing:
    """One loop's deadlines and figures; all times in ns of the process's clock."""

    def __init__(self, page: ControlPage, period_ns: int, phase_ns: int) -> None:
        """`phase_ns` is where on the grid of periods cycles lie in lock-step."""
        self.period_ns, self._phase_ns = max(1, period_ns), phase_ns
        self._step_ns = self.period_ns
        page.field("period_ns")[...] = period_ns
        names = ("heartbeat_ns", "cycles", "missed", "overruns", "interval_cycles")
        self._beat, self._cycles, self._missed, self._overruns, self._interval = (page.field(n) for n in names)
        self._figures = {
            which: [page.field(f"{which}_{figure}") for figure in FIGURES] for which in ("period", "work", "latency")
        }
        self._room = min(ROOM, 2 * INTERVAL_NS // min(self.period_ns, QUICKEST_NS))
        self._periods, self._work, self._latencies = (np.zeros(self._room) for _ in range(3))
        self._count = self._latency_count = 0
        self._start = self._deadline = self._interval_end = 0
        self._beats = True
        self._missed_count = self._overrun_count = self._cycle_count = 0
        self._missed_before = self._short_until = self._short_check = self._short_checks = self._short_ns = 0

    def begin(self, now_ns: int, simulated: bool) -> None:
        """Start the grid: at the next phase point in simulated time, now on the wall clock.

        The heartbeat is real time: in simulated time it is not ours to give.
        """
        self._beats = not simulated
        self._start = now_ns
        self._deadline = now_ns
        if simulated:
            self._deadline = now_ns - now_ns % self.period_ns + self._phase_ns
            if self._deadline <= now_ns:
                self._deadline += self.period_ns
            self._deadline -= self.period_ns  # end_of_work adds one
        self._interval_end = now_ns + INTERVAL_NS
        if self._beats:
            self._beat[...] = now_ns

    def follows(self, period_ns: int) -> None:
        """Whom we `follow` has that period: two thirds of ours begin at three places in ours, a third of it apart.

        Any of these will do. Were it one of them, it would matter which of theirs was the newest that we saw.
        """
        self._step_ns = self.period_ns // Fraction(period_ns, self.period_ns).limit_denominator(SHARES).denominator

    def follow(self, wanted_ns: int) -> None:
        """Pull the grid gently so that deadlines fall on `wanted_ns`, or whole steps from there: see `follows`."""
        error = (wanted_ns - self._deadline) % self._step_ns
        if error > self._step_ns // 2:
            error -= self._step_ns
        self._deadline += int(error * GAIN)

    def is_overloaded(self, now_ns: int) -> bool:
        """Many deadlines were missed of late."""
        return now_ns < self._short_until

    def latency(self, latency_ns: int) -> None:
        """What the process calls its latency, of this cycle; a cycle may have none."""
        if self._latency_count < self._room:
            self._latencies[self._latency_count] = latency_ns
            self._latency_count += 1

    def end_of_work(self, now_ns: int, periods: int = 1) -> int:
        """The cycle's work is done; returns the next deadline, so many periods after this cycle's."""
        work = now_ns - self._start
        if self._count < self._room:
            self._work[self._count] = work
        if work > self.period_ns:
            self._overrun_count += 1
            self._overruns[...] = self._overrun_count
        self._deadline += self.period_ns * periods
        if now_ns > self._deadline:
            skipped = (now_ns - self._deadline) // self.period_ns + 1
            self._missed_count += skipped
            self._missed[...] = self._missed_count
            self._deadline += (skipped - 1) * self.period_ns
        return self._deadline

    def early(self, now_ns: int) -> None:
        """The next cycle begins now, before its deadline; the one after it on the next point of the grid."""
        self._deadline -= -(-(self._deadline - now_ns) // self.period_ns) * self.period_ns

    def begin_work(self, now_ns: int) -> None:
        """A cycle begins."""
        if self._count < self._room:
            self._periods[self._count] = now_ns - self._start
            self._count += 1
        self._start = now_ns
        self._cycle_count += 1
        self._cycles[...] = self._cycle_count
        if self._beats:
            self._beat[...] = now_ns
        if now_ns >= self._short_check:
            self._look_at_missed(now_ns)
        if now_ns >= self._interval_end:
            self._publish(now_ns)

    def _look_at_missed(self, now_ns: int) -> None:
        much = (self._missed_count - self._missed_before) * self.period_ns > SHORT_SHARE * SHORT_CHECK_NS
        self._short_checks = self._short_checks + 1 if much else 0
        if self._short_checks >= SHORT_CHECKS:
            if (since := now_ns - self._short_until) >= 0:
                self._short_ns = min(2 * self._short_ns, SHORT_NS[1]) if since < self._short_ns else SHORT_NS[0]
            self._short_until = now_ns + self._short_ns
        self._missed_before = self._missed_count
        self._short_check = now_ns + SHORT_CHECK_NS

    def _publish(self, now_ns: int) -> None:
        kept = (("period", self._periods, self._count), ("work", self._work, self._count),
                ("latency", self._latencies, self._latency_count))
        for which, samples, count in kept:
            seconds = samples[: max(count, 1)] * (1e-9 if count else 0.0)  # nothing in this second: all 0
            place = min(len(seconds) - 1, int(0.99 * len(seconds)))
            figures = (seconds.mean(), seconds.std(), seconds.min(), seconds.max(), np.partition(seconds, place)[place])
            for cell, figure in zip(self._figures[which], figures, strict=True):
                cell[...] = figure
        self._interval[...] = self._count
        self._count = self._latency_count = 0
        self._interval_end = now_ns + INTERVAL_NS
