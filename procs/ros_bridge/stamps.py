"""ROS's time for stamps of records: time of day, or the system's own where that is simulated."""

from __future__ import annotations

from procs.ros.messages import Time
from shm.clock import local_ns, monotonic_ns

SECOND_NS = 1_000_000_000


class Stamps:
    """Of one moment; `look` takes the next one."""

    def __init__(self, simulated: bool) -> None:
        self.simulated = simulated
        self._ahead_ns = 0
        self.look()

    def look(self) -> None:
        """How far the time of day is ahead of the clock that records are stamped with; it may be set at any time."""
        self._ahead_ns = 0 if self.simulated else local_ns() - monotonic_ns()

    def ns(self, stamp_ns: int) -> int:
        """ROS's time of a record's stamp, ns."""
        return stamp_ns + self._ahead_ns


def time_of(ns: int) -> Time:
    """As ROS has it."""
    return Time(*divmod(ns, SECOND_NS))
