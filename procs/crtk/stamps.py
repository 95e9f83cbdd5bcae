"""What others call the time of a record: that of day, or the system's own where that is simulated."""

from __future__ import annotations

from trocar.shm.time.clock import local_ns, monotonic_ns


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
        """Of a record's stamp, ns."""
        return stamp_ns + self._ahead_ns
