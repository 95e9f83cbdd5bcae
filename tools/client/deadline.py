"""The end of a wait for a robot, whose time may be simulated and pass more slowly than ours. Python only."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from trocar.shm.time.clock import monotonic_ns

STANDS_NS: Final = 5_000_000_000
LOOK_NS: Final = 20_000_000
MAX_TIMEOUT_S: Final = 1e9


def seconds(timeout: float) -> float:
    """The timeout of a wait; ValueError unless it is a number that a wait can have."""
    if not is_timeout(timeout):
        raise ValueError(f"timeout is {timeout!r}; allowed: 0 to {MAX_TIMEOUT_S:g} s")
    return float(timeout)


def is_timeout(timeout: object) -> bool:
    """Whether it is a number that a wait can have."""
    return isinstance(timeout, int | float | np.number) and bool(0.0 <= timeout <= MAX_TIMEOUT_S)


class Deadline:
    """Over after this time of ours and of the robot's; a robot time that is stopped for 5 s no longer counts."""

    def __init__(self, timeout: float, robot_ns: Callable[[], int] | None = None,
                 now_ns: Callable[[], int] = monotonic_ns) -> None:
        """`timeout` s from now on. `robot_ns`: its time if simulated, read when ours is over; None: real time."""
        self._robot_ns, self._now_ns, limit_ns = robot_ns, now_ns, round(seconds(timeout) * 1e9)
        self._moved_ns, self._last = now_ns(), robot_ns() if robot_ns is not None else 0
        self._look_ns, self._end = self._moved_ns + limit_ns, self._last + limit_ns

    def is_over(self) -> bool:
        """Whether it has passed."""
        now_ns = self._now_ns()
        if now_ns < self._look_ns or self._robot_ns is None:
            return now_ns >= self._look_ns
        robot_ns = self._robot_ns()
        if robot_ns != self._last:
            self._last, self._moved_ns = robot_ns, now_ns
        self._look_ns = now_ns + max(min(self._end - robot_ns, STANDS_NS // 10), LOOK_NS)
        return robot_ns >= self._end or now_ns - self._moved_ns >= STANDS_NS
