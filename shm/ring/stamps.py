"""Stamps of a ring's newest records, without their content: for measuring rates."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trocar.shm.memory.segment import Segment
from trocar.shm.ring.ring import HEAD, LAST_SEQUENCE


def head_of(segment: Segment) -> int:
    """Number of the newest record of a ring; 0: none, or an implausible one."""
    head = int.from_bytes(segment.view[HEAD * 8 : HEAD * 8 + 8], "little")
    return head if head <= LAST_SEQUENCE else 0


def newest_stamps(segment: Segment, count: int) -> NDArray[np.int64]:
    """Stamps, ns, of up to `count` newest records of a ring, oldest first; the one being overwritten is left out."""
    header, head = segment.header, head_of(segment)
    words = np.frombuffer(segment.view, np.uint64)
    numbers = np.arange(max(1, head - min(count, header.depth - 1) + 1), head + 1, dtype=np.int64)
    at = (header.first + numbers % header.depth * header.stride) // 8
    before = words[at]
    stamps = words[at + 1].astype(np.int64)
    kept: NDArray[np.int64] = stamps[(before == numbers.astype(np.uint64)) & (words[at] == before)]
    return kept
