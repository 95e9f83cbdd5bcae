"""One number of a topic, sample by sample, for the page Plots: `plot:PSM1/state.position[1]`."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

import numpy as np

from trocar.procs.crtk.field_paths import FieldCells, FieldPath, cells_of, parse_path
from trocar.procs.crtk.topics import TopicEntry, find
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.sources import PROGRAM, Maker
from trocar.procs.gui.validity import checked
from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.system.subscriptions import Subscriber

BEFORE_NS: Final = 60_000_000_000
"""Of what was before somebody looked, as far as the ring goes back."""


class PlotSource:
    """The samples since the last tick; no number where its robot, or what measures it, is away."""

    def __init__(self, document: SystemConfig, entry: TopicEntry, path: FieldPath) -> None:
        """Attach, and want it with the group of the field; SegmentError or ValueError when there is none such."""
        system = document.name
        self._reader: RingReader = directory.reader(system, entry.instance, entry.ring, often=False)
        self._subscriber: Subscriber | None = None
        try:
            self._cells = checked(document, entry.instance, entry.ring, _number(self._reader, entry, path),
                                  self._reader.dtype)
            self._subscriber = Subscriber(system, entry.instance, PROGRAM)
            group = self._cells.field.group
            self._subscriber.want(entry.ring, *([group] if group else []))
        except BaseException:
            self.close()
            raise
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
        values = self._cells.numbers(rows)[:, 0]
        return {"age": 0.0, "t": np.round(rows["stamp_ns"] * 1e-9, 5), "v": np.round(values, 9)}

    def close(self) -> None:
        """Unmap, want it no more."""
        self._reader.close()
        if self._subscriber is not None:
            self._subscriber.close()


def _number(reader: RingReader, entry: TopicEntry, path: FieldPath) -> FieldCells:
    reader.newest()
    cells = cells_of(entry, path, np.frombuffer(reader.record, reader.dtype))
    if cells.is_text or len(cells.labels) != 1:
        raise ValueError(f"{path.text} is not one number")
    if cells.labels[0] != path.text:  # one name for one number: pages share what is read
        raise ValueError(f"{path.text} is called {cells.labels[0]}")
    return cells


def plot_of(document: SystemConfig, name: str) -> Maker:
    """What makes the source of a field path; ValueError when that is none, or not one number."""
    path = parse_path(name)
    try:
        entry = find(document.name, path.topic)
        reader = directory.reader(document.name, entry.instance, entry.ring, often=False)
    except SegmentError as error:
        raise ValueError(str(error)) from None
    try:
        _number(reader, entry, path)
    finally:
        reader.close()
    return partial(PlotSource, document, entry, path)
