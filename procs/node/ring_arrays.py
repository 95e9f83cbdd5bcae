"""Rings that the native library reads by itself: their memory layout, in arrays."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from trocar.shm.memory.segment import HEAD_AT
from trocar.shm.ring.ring import RingReader

Addresses = NDArray[np.int64]


class RingArrays:
    """One array per property, one element per ring; addresses are valid until the rings are closed."""

    def __init__(self, rings: Sequence[RingReader], fields: Sequence[str] = ()) -> None:
        """`fields`: which have `offsets`, in records that are all of one layout."""
        self._rings, found = rings, [ring.addresses for ring in rings]
        self.count = len(rings)
        self.head: Addresses = np.array([begin + HEAD_AT for begin, _, _ in found], dtype=np.int64)
        self.copy: Addresses = np.array([copy for _, copy, _ in found], dtype=np.int64)
        self.slots: Addresses = np.array([slots for _, _, slots in found], dtype=np.int64)
        self.depth: Addresses = np.array([ring.depth for ring in rings], dtype=np.int64)
        self.stride: Addresses = np.array([ring.stride for ring in rings], dtype=np.int64)
        self.size: Addresses = np.array([ring.dtype.itemsize for ring in rings], dtype=np.int64)
        self.seen: Addresses = np.zeros(len(rings), dtype=np.int64)
        """Sequence number of the newest record that was read."""
        places = rings[0].dtype.fields if rings else None
        self.offsets: Addresses = np.array([places[name][1] if places else 0 for name in fields], dtype=np.int64)

    def newest(self, place: int) -> bool:
        """Take the newest record of a ring in Python, if newer than the one the native library has read."""
        ring = self._rings[place]
        self.hand_over(place)
        found = ring.newest()
        self.seen[place] = ring.sequence
        return found

    def hand_over(self, place: int) -> None:
        """Have the reader continue behind the newest record that the native library has read."""
        ring = self._rings[place]
        ring.sequence = max(ring.sequence, int(self.seen[place]))
