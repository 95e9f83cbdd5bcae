"""Places of a segment that one process at a time may have, each locked by a byte of the file."""

from __future__ import annotations

import errno
import fcntl
import os
import struct
from collections.abc import Callable
from functools import partial

from trocar.shm.memory.segment import Segment, SegmentError

OFD_GETLK = 36
OFD_SETLK = 37  # Linux: open-file-description locks; given back by the kernel when the description closes
LOCK = struct.Struct("hhqqi4x")


class AllTaken(SegmentError):
    """No place is free and fit; `places` are the occupied ones."""

    def __init__(self, text: str, places: list[int]) -> None:
        super().__init__(text)
        self.places = places


class Places:
    """Places of a segment, each with a lock byte in the file: the kernel frees the place of a process that ends."""

    def __init__(self, segment: Segment, first: int, count: int) -> None:
        """`count` places; the lock bytes begin at file offset `first`."""
        self._segment, self._first, self._count = segment, first, count

    def claim(self, fit: Callable[[int], bool]) -> int:
        """Take a place that is free and `fit`; AllTaken if there is none. Given back at close."""
        taken = []
        for place in range(self._count):
            if not self.take(place):
                taken.append(place)
            elif fit(place):
                self._segment.at_close(partial(self.give_back, place), unlocks=True)
                return place
            else:
                self.give_back(place)
        raise AllTaken(f"{self._segment.name}: all {self._count} places are taken", taken)

    def take(self, place: int) -> bool:
        """Take a free place until `give_back`. Not for two threads: both would get it."""
        return _lock(self._segment.fd, self._first + place)

    def is_taken(self, place: int) -> bool:
        """Whether another process has a place; takes nothing."""
        asked = LOCK.pack(fcntl.F_WRLCK, os.SEEK_SET, self._first + place, 1, 0)
        kind: int = LOCK.unpack(fcntl.fcntl(self._segment.fd, OFD_GETLK, asked))[0]
        return kind != fcntl.F_UNLCK

    def give_back(self, place: int) -> None:
        """Release a place."""
        _unlock(self._segment.fd, self._first + place)


def _lock(fd: int, at: int) -> bool:
    try:
        fcntl.fcntl(fd, OFD_SETLK, LOCK.pack(fcntl.F_WRLCK, os.SEEK_SET, at, 1, 0))
    except OSError as error:
        if error.errno in (errno.EAGAIN, errno.EACCES):
            return False
        raise
    return True


def _unlock(fd: int, at: int) -> None:
    fcntl.fcntl(fd, OFD_SETLK, LOCK.pack(fcntl.F_UNLCK, os.SEEK_SET, at, 1, 0))
