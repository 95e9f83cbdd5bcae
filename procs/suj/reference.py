"""The tip of the arm on the reference set-up arm, from that arm's own record."""

from __future__ import annotations

from typing import Final

from procs.kinematics.poses import matrix_from_pose, normalised
from procs.suj.setups import Array
from shm.ring import RingReader

STALE_NS: Final = 50_000_000


class CarriedTip:
    """The tip of one arm, in its base."""

    def __init__(self, name: str, ring: RingReader) -> None:
        """`name` of the arm is that of its tip's frame, too."""
        self.name, self._ring = name, ring
        self._valid, self._pose = ring.field("cartesian_valid"), ring.field("local_measured_cp")
        self._kept: Array | None = None
        self._stamp_ns = 0

    def pose(self, now_ns: int) -> Array | None:
        """The newest (4, 4); None when it is not valid or older than 50 ms."""
        if self._ring.newest():  # a torn one leaves the last, to grow old
            self._stamp_ns, self._kept = self._ring.stamp_ns, self._read()
        fresh = self._stamp_ns > 0 and -STALE_NS <= now_ns - self._stamp_ns <= STALE_NS
        return self._kept if fresh else None

    def _read(self) -> Array | None:
        if not self._valid.item():
            return None
        try:
            return matrix_from_pose(normalised(self._pose))
        except ValueError:
            return None
