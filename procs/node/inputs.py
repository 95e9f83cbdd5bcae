"""Input from another process: its newest record, and whether that is still fresh."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final

from numpy.typing import NDArray

from trocar.procs.tables.manifest import LATE_S
from trocar.shm.ring.ring import RingReader

Fields = Callable[[str], NDArray[Any]]
"""Gives the array of a record's field by its name."""
LATE_NS: Final = round(LATE_S * 1e9)
FOR_EVER_NS: Final = 1 << 62
"""A time that no clock reaches."""
SETUP_LATE_S: Final = 0.05
"""The corresponding time between setup joints and the arms that they carry."""


class Input:
    """The newest record of a ring, as of the last `look`.

    `whole`: that look read a record; after a torn read the previous record stays in force and ages. `restarted`: the
    ring has a new writer since the previous look.
    """

    def __init__(self, ring: RingReader, late_s: float = LATE_S) -> None:
        """Records older than `late_s` are not fresh."""
        self.ring, self.late_ns = ring, round(late_s * 1e9)
        self.field = ring.field
        self.stamp_ns = self._now_ns = self.epoch = 0
        self.whole = self.restarted = False

    def look(self, now_ns: int) -> bool:
        """Read the newest record, once a cycle; returns `whole`."""
        ring, epoch = self.ring, self.ring.epoch
        self._now_ns, self.restarted, self.epoch = now_ns, self.epoch not in (0, epoch), epoch
        self.whole = ring.newest()
        if self.whole:
            self.stamp_ns = ring.stamp_ns
        return self.whole

    @property
    def age_ns(self) -> int:
        """Time since its stamp, absolute: a stamp in the future counts as an equally old one."""
        return abs(self._now_ns - self.stamp_ns)

    @property
    def fresh(self) -> bool:
        """Whether there is a record that is not too old."""
        return self.stamp_ns > 0 and self.age_ns <= self.late_ns

    def sampled(self, before_ns: int) -> bool:
        """Whether the look read a record whose samples, taken `before_ns` before its stamp, are not too old."""
        return self.whole and self.stamp_ns > 0 and self.age_ns + abs(before_ns) <= self.late_ns
