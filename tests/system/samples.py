"""What io samples, seen from outside, and boards that stand still."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from typing import Any

from tests.system.robot import Robot, wait_for
from trocar.shm.ring.ring import RingReader
from trocar.shm.time.clock import monotonic_ns, pause

Records = Callable[[Robot, str, str], RingReader]


def newest(reader: RingReader, field: str) -> Any:
    assert reader.newest()
    return reader.field(field).copy()


def is_well(reader: RingReader, since_ns: int) -> bool:
    """A fifth of a second of nearly nothing but good samples; a crowded machine misses some."""
    rows = reader.since(max(since_ns, monotonic_ns() - 200_000_000))
    return len(rows) > 25 and float(rows["valid"].mean()) > 0.9


def stop_boards(robot: Robot, seconds: float, ios: list[RingReader]) -> None:
    """Until all of these have good samples again."""
    boards = robot.pid("boards")
    os.kill(boards, signal.SIGSTOP)
    try:
        pause(seconds)
    finally:
        os.kill(boards, signal.SIGCONT)
    resumed_ns = monotonic_ns()
    for reader in ios:
        wait_for(lambda: is_well(reader, resumed_ns), 60, f"good samples again after {seconds} s")  # noqa: B023
