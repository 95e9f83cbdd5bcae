"""Real clocks: no other module reads one. Simulated time, in lock-step or paced: shm/time/lockstep.py."""

from __future__ import annotations

import contextlib
import socket
import time
from collections.abc import Callable, Iterator
from functools import partial

# Real monotonic time, ns, for intervals that must be bounded in real time even in lock-step (sockets, tools).
monotonic_ns = time.monotonic_ns
# The same, but it also counts while the computer is suspended; only for durations.
boottime_ns: Callable[[], int] = (
    partial(time.clock_gettime_ns, time.CLOCK_BOOTTIME) if hasattr(time, "CLOCK_BOOTTIME") else monotonic_ns)
# The computer's wall-clock time, ns since 1970; only for people and for other programs' records.
local_ns: Callable[[], int] = (
    partial(time.clock_gettime_ns, time.CLOCK_REALTIME) if hasattr(time, "CLOCK_REALTIME") else monotonic_ns)
_sleeps: list[Callable[[float], None]] = [time.sleep]


def pause(seconds: float) -> None:
    """Sleep in real time, or let the time of a system in this process pass (`sleeping_by`).

    For tools and the supervisor.
    """
    _sleeps[-1](seconds)


@contextlib.contextmanager
def sleeping_by(passes: Callable[[float], None]) -> Iterator[None]:
    """In this block `pause` calls that, with seconds, instead of sleeping."""
    _sleeps.append(passes)
    try:
        yield
    finally:
        _sleeps.remove(passes)


class WallClock:
    """CLOCK_MONOTONIC."""

    simulated = False
    wakeup: socket.socket | None = None

    def __init__(self, spin_ns: int = 0) -> None:
        """`spin_ns`: the last part of every sleep is spent looking at the clock, which is more exact than waking up."""
        self.spin_ns = spin_ns

    def now_ns(self) -> int:
        """Monotonic time."""
        return time.monotonic_ns()

    def sleep_until(self, deadline_ns: int, stopped: Callable[[], bool]) -> None:
        """Sleep until the deadline; returns at once if it has passed."""
        left = deadline_ns - self.spin_ns - time.monotonic_ns()
        if left > 0:
            time.sleep(left * 1e-9)  # CPython sleeps with clock_nanosleep on CLOCK_MONOTONIC
        while self.spin_ns and time.monotonic_ns() < deadline_ns:
            pass
