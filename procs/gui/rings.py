"""Rings as sources read them: the present ones, or their records up to a moment in the past."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from functools import cached_property
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.system import SystemConfig
from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory


class Readable(Protocol):
    """What sources use of a ring, see RingReader."""

    sequence: int

    @property
    def stamp_ns(self) -> int: ...
    @property
    def dtype(self) -> np.dtype[np.void]: ...
    @property
    def depth(self) -> int: ...
    @property
    def gone(self) -> str: ...
    def field(self, name: str) -> NDArray[Any]: ...
    def newest(self) -> bool: ...
    def next(self) -> bool: ...
    def last(self, count: int) -> NDArray[Any]: ...
    def since(self, stamp_ns: int) -> NDArray[Any]: ...
    def close(self) -> None: ...


Rings = Callable[[str, str, str, str | None], Readable]
"""Opens a ring of a system, an instance and a topic, for the kind of its writer; SegmentError if it cannot be read."""


def present(system: str, instance: str, ring: str, kind: str | None = None) -> RingReader:
    """A ring as it is now."""
    return directory.reader(system, instance, ring, kind, often=False)


class PastReader:
    """The records of a ring up to a moment. Their stamps are times of day: recordings of several runs have no other
    time in common.
    """

    gone = ""

    def __init__(self, dtype: np.dtype[np.void], rows: Callable[[], NDArray[Any]]) -> None:
        """`rows`: oldest first; called at the first use, when it is known what else of the past is read."""
        self.dtype, self._look = dtype, rows
        self._record = np.zeros(1, dtype)
        self.sequence = 0

    @cached_property
    def _rows(self) -> NDArray[Any]:
        return self._look()

    @property
    def stamp_ns(self) -> int:
        """Of the newest record."""
        return int(self._record["stamp_ns"][0])

    @property
    def depth(self) -> int:
        """As of a ring that keeps all of them."""
        return len(self._rows) + 1

    def field(self, name: str) -> NDArray[Any]:
        """A view on a field of the newest record."""
        view: NDArray[Any] = self._record[name]
        return view.reshape(view.shape[1:])

    def newest(self) -> bool:
        """Copy the newest record; False if there is none."""
        if not len(self._rows):
            return False
        self._record[0] = self._rows[-1]
        self.sequence = int(self._record["sequence"][0])
        return True

    def next(self) -> bool:
        """Nothing follows in the past."""
        return False

    def last(self, count: int) -> NDArray[Any]:
        """The newest ones, oldest first."""
        return self._rows[max(0, len(self._rows) - count):]

    def since(self, stamp_ns: int) -> NDArray[Any]:
        """Those with this stamp or a later one."""
        return self._rows[self._rows["stamp_ns"] >= stamp_ns]

    def close(self) -> None:
        """Nothing is open."""


def seen_ns(reader: Readable, now_ns: int) -> int:
    """When the record read last was new. A present one is new when it is read first: in simulated time, its stamp does
    not tell its age.
    """
    return reader.stamp_ns if isinstance(reader, PastReader) else now_ns


def event_rings(document: SystemConfig, rings: Rings) -> list[tuple[str, Readable]]:
    """The events of all processes, except of `system`, which repeats those of the others."""
    found: list[tuple[str, Readable]] = []
    for row in document.processes:
        if row.kind != "system":
            with contextlib.suppress(SegmentError):
                found.append((row.name, rings(document.name, row.name, "events", None)))
    return found
