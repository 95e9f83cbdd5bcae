"""Pauses: a loop that was held up measures for how long, on a clock that counts suspend as well.

Pure but for the clock that it is given.
"""

from __future__ import annotations

from collections.abc import Callable

from trocar.shm.time.clock import boottime_ns

NEVER = 1 << 62


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
