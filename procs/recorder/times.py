"""When a record was written, by the clock on the wall: from its stamp, in whatever time the system has."""

from __future__ import annotations

from trocar.shm.time.clock import local_ns, monotonic_ns
from trocar.shm.time.system_time import SystemTime


class LocalTimes:
    """Of the stretch between two looks: both clocks are known at its ends."""

    def __init__(self, time: SystemTime) -> None:
        self._time = time
        self.system_ns = self._since_ns = time.now_ns()
        self.monotonic_ns = monotonic_ns()
        self.local_ns = self._since_local_ns = local_ns()

    def look(self) -> None:
        """The next stretch ends now."""
        self._since_ns, self._since_local_ns = self.system_ns, self.local_ns
        self.system_ns, self.monotonic_ns, self.local_ns = self._time.now_ns(), monotonic_ns(), local_ns()

    def of(self, stamp_ns: int) -> int:
        """Time of day of a stamp; simulated time went as fast as it did since the last look."""
        behind, passed = self.system_ns - stamp_ns, self.system_ns - self._since_ns
        if self._time.simulated and 0 < behind <= passed:
            behind = behind * (self.local_ns - self._since_local_ns) // passed
        return max(0, self.local_ns - behind)
