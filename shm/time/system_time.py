"""The time of a running system for programs that time does not wait for: tools, scripts, bridges."""

from __future__ import annotations

import socket
from collections.abc import Callable
from typing import Final

from trocar.shm.memory.closable import Closable
from trocar.shm.memory.parts import parts_of
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.lockstep import NEVER, SCHEMA, Table, clock_page

WALL, PACED, LOCKSTEP = "wall", "paced", "lockstep"
MIN_S: Final = 2e-4  # between two looks at simulated time
MAX_S: Final = 0.02
HELD_S: Final = 0.002  # the same while a program holds time


class SystemTime(Closable):
    """Real on the wall clock, else the system's own. Close it."""

    spin_ns = 0
    wakeup: socket.socket | None = None

    def __init__(self, system: str) -> None:
        """Attach; a system that has no clock page, or is not there, has the wall clock."""
        self.clock = WALL
        """WALL, PACED or LOCKSTEP."""
        self._page = clock_page(system) if (system, "supervisor", "clock") in parts_of(system) else None
        if self._page is not None:
            self.clock = PACED if Table.of_info(self._page.header.info).paced else LOCKSTEP
            first = self._page.header.first
            self._words, self._now = self._page.words(), (first + SCHEMA.offset("now_ns")) // 8
            self._speed = self._page.view[first + SCHEMA.offset("speed") :][:8].cast("d")
            self._page.at_close(self._speed.release)
            self._limit, self._active = ((first + SCHEMA.offset(field)) // 8 for field in ("limit_ns", "active"))

    @property
    def simulated(self) -> bool:
        """Whether the system has simulated time."""
        return self._page is not None

    @property
    def speed(self) -> float:
        """Of the last second: 0.62 where 0.62 s passed for the system while 1 s passed really."""
        return 1.0 if self._page is None else float(self._speed[0])

    @property
    def is_held(self) -> bool:
        """Whether a program holds time, which is stopped for now (shm/time/held_time.py)."""
        return self._page is not None and 0 < self._words[self._limit] <= self.now_ns()

    @property
    def members(self) -> tuple[str, ...]:
        """The processes that it waits for; none on the wall clock."""
        if self._page is None:
            return ()
        members = Table.of_info(self._page.header.info).members
        return tuple(name for place, name in enumerate(members) if self._words[self._active + place] == 1)

    def sleep_until(self, deadline_ns: int, stopped: Callable[[], bool]) -> None:
        """Sleep until this time of the system."""
        self.pause_until(deadline_ns)

    def now_ns(self) -> int:
        """The system's time, as its records are stamped."""
        return monotonic_ns() if self._page is None else min(self._words[self._now], NEVER)

    def pause(self, seconds: float, real_s: float | None = None) -> None:
        """Sleep this long in the system's time; at most `real_s` in real time (the system's time may be stopped)."""
        self.pause_until(self.now_ns() + round(seconds * 1e9), real_s)

    def pause_until(self, deadline_ns: int, real_s: float | None = None) -> None:
        """Sleep until this time of the system; at most `real_s` in real time."""
        end = None if real_s is None else monotonic_ns() + round(real_s * 1e9)
        while (left := (deadline_ns - self.now_ns()) * 1e-9) > 0.0:
            if end is not None:
                if monotonic_ns() >= end:
                    return
                left = min(left, real_s or 0.0)
            if self._page is not None:
                # In lock-step its speed is unknown; paced it is never early.
                least = HELD_S if self.is_held else MIN_S
                left = max(least, min(left if self.clock == PACED else least, MAX_S))
            pause(left)

    def close(self) -> None:
        """Unmap."""
        if self._page is not None:
            self._page.close()


class Patience(Closable):
    """This long in a system's time, at most ten times as long in real time."""

    def __init__(self, system: str, seconds: float) -> None:
        self._time = SystemTime(system)
        self._end_ns = self._time.now_ns() + round(seconds * 1e9)
        self._real_ns = monotonic_ns() + round(seconds * 10e9)

    @property
    def is_over(self) -> bool:
        """Whether the waiting time is over."""
        return self._time.now_ns() >= self._end_ns or monotonic_ns() >= self._real_ns

    def close(self) -> None:
        """Unmap."""
        self._time.close()


def speed_in_words(time: SystemTime) -> str:
    """Which clock, and how fast: "paced, 0.62 of real time"."""
    return "wall" if not time.simulated else f"{time.clock}, {time.speed:.2f} of real time"
