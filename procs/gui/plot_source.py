"""One number of a record, sample by sample, for the page Plots: `plot:INSTANCE/RING/FIELD/INDEX`."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np

from procs.gui.sources import PROGRAM, Maker
from shm import directory
from shm.ring import RingReader
from shm.segment import SegmentError
from shm.subscriptions import Subscriber

BEFORE_NS: Final = 60_000_000_000
"""Of what was before somebody looked, as far as the ring goes back."""


class PlotSource:
    """The samples since the last tick."""

    def __init__(self, system: str, instance: str, ring: str, field: str, index: int) -> None:
        """Attach, and want it with the group of the field; SegmentError or ValueError when there is none such."""
        self._reader: RingReader = directory.reader(system, instance, ring, often=False)
        self._subscriber: Subscriber | None = None
        try:
            cell = _cell(self._reader, field, index)
            self._subscriber = Subscriber(system, instance, PROGRAM)
            self._subscriber.want(ring, *_groups(instance, ring, field, self._reader))
        except BaseException:
            self.close()
            raise
        self._field, self._index, self._size = field, index, max(1, cell.size)
        self._stamp_ns, self._seen_ns = 0, 0

    def read(self, now_ns: int) -> dict[str, Any]:
        """`t`, s, and `v` of samples that are new."""
        if not self._reader.newest():
            return {"age": None}
        if self._reader.stamp_ns == self._stamp_ns:
            return {"age": round((now_ns - self._seen_ns) * 1e-9, 1), "t": [], "v": []}
        rows = self._reader.since(max(self._stamp_ns + 1, self._reader.stamp_ns - BEFORE_NS))
        if not len(rows):
            return {"age": 0.0, "t": [], "v": []}
        self._stamp_ns, self._seen_ns = int(rows["stamp_ns"][-1]), now_ns
        values = rows[self._field].reshape(len(rows), -1)[:, self._index].astype(np.float64)
        return {"age": 0.0, "t": np.round(rows["stamp_ns"] * 1e-9, 5), "v": np.round(values, 9)}

    def close(self) -> None:
        """Unmap, want it no more."""
        self._reader.close()
        if self._subscriber is not None:
            self._subscriber.close()


def _cell(reader: RingReader, field: str, index: int) -> np.ndarray[Any, Any]:
    if field not in (reader.dtype.names or ()):
        raise ValueError(f"there is no field {field[:40]}")
    cell = reader.field(field)
    if cell.dtype.kind not in "fiub" or not 0 <= index < max(1, cell.size):
        raise ValueError(f"{field} has no number {index}")
    return cell


def _groups(instance: str, ring: str, field: str, reader: RingReader) -> tuple[str, ...]:
    kind = str(reader.info.get("kind", ""))
    try:
        row = next(row for row in directory.topic_of(kind, ring).fields if row.name == field)
    except (KeyError, StopIteration):
        return ()
    return (row.group,) if row.group else ()


def plot_of(system: str, name: str) -> Maker:
    """What makes `INSTANCE/RING/FIELD/INDEX`; ValueError when that is none."""
    parts = name.split("/")
    if len(parts) != 4 or not (parts[3].isascii() and parts[3].isdecimal()):
        raise ValueError(f"{name[:80]}: a plot is INSTANCE/RING/FIELD/INDEX")
    instance, ring, field, index = parts
    try:
        reader = directory.reader(system, instance, ring, often=False)
    except SegmentError as error:
        raise ValueError(str(error)) from None
    try:
        _cell(reader, field, int(index))
    finally:
        reader.close()
    return partial(PlotSource, system, instance, ring, field, int(index))
