"""Records of a ring kept while `scope` waits: chosen cells, every record once, and the gaps."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from trocar.procs.crtk.field_paths import FieldCells
from trocar.shm.ring.ring import RingReader

Stamps = NDArray[np.int64]

TRIES = 4
SPARE = 64
"""Maximum number of records that arrive while we read the newest ones."""


@dataclass(frozen=True, slots=True)
class Gap:
    """Lost records: how many, behind the one of this stamp."""

    topic: str
    stamp_ns: int
    lost: int


@dataclass(frozen=True, slots=True)
class WindowRows:
    """Records of one ring in order: stamps, numbers, and of each field its cells (records, cells)."""

    stamps: Stamps
    sequences: NDArray[np.uint64]
    columns: tuple[NDArray[Any], ...]

    def __len__(self) -> int:
        return len(self.stamps)

    def between(self, first_ns: int, last_ns: int) -> WindowRows:
        """Those with a stamp from `first_ns` to `last_ns`."""
        chosen = (self.stamps >= first_ns) & (self.stamps <= last_ns)
        return WindowRows(self.stamps[chosen], self.sequences[chosen], tuple(column[chosen] for column in self.columns))


class RingWindow:
    """The newest records of one ring, as long as they are needed; call `collect` often enough."""

    def __init__(self, topic: str, reader: RingReader, cells: Sequence[FieldCells]) -> None:
        """`topic` is the name of the ring. Nothing is kept yet."""
        self.topic, self.cells, self._reader = topic, tuple(cells), reader
        self._pieces: list[WindowRows] = [self._rows(np.zeros(0, reader.dtype))]
        self._seen = 0
        self._is_first = True

    @property
    def newest_ns(self) -> int:
        """Stamp of the newest record kept, 0: none."""
        return max((int(piece.stamps[-1]) for piece in self._pieces if len(piece)), default=0)

    @property
    def gone(self) -> str:
        """Its writer, if that has ended."""
        return self._reader.gone

    @property
    def rate_hz(self) -> float:
        """Rate of its records; 0: on events."""
        rate = self._reader.info.get("rate_hz", 0.0)
        return float(rate) if isinstance(rate, int | float) else 0.0

    def collect(self, from_ns: int = 0) -> NDArray[Any]:
        """Read new records, the first time the history from `from_ns` on; returns these records, complete."""
        if self._is_first:
            records, self._is_first = self._reader.since(from_ns), False
            self._seen = int(records["sequence"][-1]) if len(records) else self._reader.head
        else:
            self._seen = min(self._seen, self._reader.head)  # no writer goes back: restart rather than wait for it
            records = _behind(self._reader, self._seen)
            if len(records):
                self._seen = int(records["sequence"][-1])
        if len(records):
            self._pieces.append(self._rows(records))
        return records

    def newest_before(self, stamp_ns: int) -> NDArray[Any]:
        """The newest record that is older, complete: earlier values of the fields; empty if none is kept."""
        for count in (SPARE, self._reader.depth):  # usually it is among the newest few
            records = self._reader.last(count)
            records = records[records["stamp_ns"] < stamp_ns]
            if len(records):
                break
        return records[-1:]

    def forget(self, before_ns: int) -> None:
        """Older records are no longer needed."""
        while len(self._pieces) > 1 and (not len(self._pieces[0]) or int(self._pieces[0].stamps[-1]) < before_ns):
            del self._pieces[0]

    def rows(self) -> WindowRows:
        """All that is kept, oldest first."""
        pieces = self._pieces
        return WindowRows(np.concatenate([piece.stamps for piece in pieces]),
                    np.concatenate([piece.sequences for piece in pieces]),
                    tuple(np.concatenate([piece.columns[k] for piece in pieces]) for k in range(len(self.cells))))

    def _rows(self, records: NDArray[Any]) -> WindowRows:
        columns = tuple(each.raw(records) if each.is_text else each.numbers(records) for each in self.cells)
        return WindowRows(records["stamp_ns"].copy(), records["sequence"].copy(), columns)

    def close(self) -> None:
        """Unmap."""
        self._reader.close()


def _behind(reader: RingReader, seen: int) -> NDArray[Any]:
    """Every record behind number `seen`; missing ones were overwritten.

    The writer continues during the read: the first of the requested newest ones may be too new by then.
    """
    for _ in range(TRIES):
        records: NDArray[Any] = reader.last(reader.head - seen + SPARE)
        records = records[records["sequence"] > seen]
        if not len(records) or int(records["sequence"][0]) == seen + 1:
            break
    return records


def gaps_of(topic: str, rows: WindowRows) -> list[Gap]:
    """Where numbers of records are missing between two that are there."""
    steps = np.diff(rows.sequences.astype(np.int64))
    return [Gap(topic, int(rows.stamps[k]), int(steps[k]) - 1) for k in np.flatnonzero(steps > 1)]
