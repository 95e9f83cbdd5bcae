"""Where the set-up joints put an arm's base: their newest record, as long as it is fresh.

A record that is too old is none: set-up joints whose process has died may have been moved since.
"""

from __future__ import annotations

from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from procs.kinematics.poses import POSE, PoseError, matrix_from_pose, unit_quaternion

Array = NDArray[np.float64]

STALE_NS: Final = 50_000_000  # set-up joints write 500 records a second


class SetupRecord(Protocol):
    """The ring of a process `suj`, as `shm.ring.RingReader` has it."""

    @property
    def stamp_ns(self) -> int:
        """Stamp of the record read last, 0: there was none."""

    def newest(self) -> bool:
        """Read the newest record; False when none could be had whole."""

    def field(self, name: str) -> NDArray[Any]:
        """A view on a field of the record."""


class SetupBase:
    """The base frame of one arm. After `update`: `base` (4, 4), None while it is unknown, and its `frame`."""

    def __init__(self, ring: SetupRecord, place: int, stale_ns: int = STALE_NS) -> None:
        """`place` is that of the set-up arm in the record; older records than `stale_ns` don't count."""
        self._ring, self._stale_ns = ring, stale_ns
        self._valid = ring.field("base_valid")[place : place + 1].reshape(())
        self._frame = ring.field("reference_frame")[place : place + 1].reshape(())
        self._pose: Array = ring.field("measured_cp")[place]
        self._kept: Array = np.zeros(POSE)
        self._kept_frame = b""
        self._stamp_ns = 0
        self._good = False
        self.base: Array | None = None
        self.frame = ""

    def update(self, now_ns: int) -> bool:
        """Look at the newest record; True when `base` or `frame` have changed."""
        read = self._ring.newest()
        if read:
            self._stamp_ns = self._ring.stamp_ns
            self._good = bool(self._valid.item())
        known = self._good and self._stamp_ns > 0 and -self._stale_ns <= now_ns - self._stamp_ns <= self._stale_ns
        if not known:
            return self._forget()
        if not read:  # torn: the one before stays in force, to grow old
            return False
        if self.base is not None and self._frame.item() == self._kept_frame and np.array_equal(self._pose, self._kept):
            return False
        return self._take()

    def _forget(self) -> bool:
        changed = self.base is not None
        self.base, self.frame = None, ""
        return changed

    def _take(self) -> bool:
        """What the record says is believed when it is a pose."""
        pose, frame = self._pose.copy(), bytes(self._frame.item())
        try:
            pose[3:] = unit_quaternion(pose[3:])
        except PoseError:
            return self._forget()
        if not np.isfinite(pose).all():
            return self._forget()
        self._kept[...], self._kept_frame = self._pose, frame
        self.base, self.frame = matrix_from_pose(pose), frame.decode(errors="replace")
        return True


def place_of(info: dict[str, Any], name: str) -> int:
    """The place of a set-up arm in its process's record, from the header's info; ValueError names what there is."""
    known = list(info.get("setups", {}))
    if name not in known:
        raise ValueError(f"no set-up arm {name}; there are {', '.join(known) or 'none'}")
    return known.index(name)
