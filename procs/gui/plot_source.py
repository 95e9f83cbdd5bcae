"""Numbers sample by sample: `plot:PSM1/state.position[1]` for the page Plots, an axis of a robot for the page PID."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.crtk.field_paths import FieldCells, FieldPath, cells_of, parse_path
from trocar.procs.crtk.topics import TopicEntry, find
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.rings import PastReader, Rings, present
from trocar.procs.gui.robots import IoRobot
from trocar.procs.gui.sources import Maker, WantedRing
from trocar.procs.gui.validity import checked
from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.topics import IO_STATE

PLOTTED_NS: Final = 60_000_000_000
TRACED_NS: Final = 1_000_000_000
"""For history from before the page was opened, as far as the ring goes back."""
SIGNALS: Final = ("position", "setpoint_position", "velocity", "setpoint_velocity", "effort", "setpoint_effort",
                  "disturbance", "position_error")
CLOSEST_S: Final = 0.002
"""Between two samples of an axis that are sent."""


class SampleSource(WantedRing, ABC):
    """The samples of a ring since the last tick."""

    before_ns: int
    _stamp_ns = _seen_ns = 0

    def read(self, now_ns: int) -> dict[str, Any]:
        """`t`, s, and `v` of samples that are new."""
        if not self._reader.newest():
            return {"age": None}
        if self._reader.stamp_ns == self._stamp_ns:
            return {"age": round((now_ns - self._seen_ns) * 1e-9, 1), "t": [], "v": []}
        before_ns = self._reader.stamp_ns if isinstance(self._reader, PastReader) else self.before_ns
        rows = self._reader.since(max(self._stamp_ns + 1, self._reader.stamp_ns - before_ns))
        if not len(rows):
            return {"age": 0.0, "t": [], "v": []}
        self._stamp_ns, self._seen_ns = int(rows["stamp_ns"][-1]), now_ns
        return {"age": 0.0} | self._shown(rows)

    @abstractmethod
    def _shown(self, rows: NDArray[Any]) -> dict[str, Any]:
        """The data sent for these records."""


class PlotSource(SampleSource):
    """One number of a topic; no number while its robot, or the board that measures it, is absent."""

    before_ns = PLOTTED_NS

    def __init__(self, document: SystemConfig, entry: TopicEntry, path: FieldPath, rings: Rings = present) -> None:
        """Attach, and subscribe with the group of the field; SegmentError or ValueError if it does not exist."""
        reader = directory.reader(document.name, entry.instance, entry.ring, often=False)
        try:
            self._cells = checked(document, entry.instance, entry.ring, _number(reader, entry, path), reader.dtype)
        finally:
            reader.close()
        group = self._cells.field.group
        super().__init__(document.name, entry.instance, entry.ring, *([group] if group else []), rings=rings)

    def _shown(self, rows: NDArray[Any]) -> dict[str, Any]:
        values = self._cells.numbers(rows)[:, 0]
        return {"t": np.round(rows["stamp_ns"] * 1e-9, 5), "v": np.round(values, 9)}


class TraceSource(SampleSource):
    """Trace of the joint controller of one axis of a robot: in `v` a list for each of `SIGNALS`."""

    before_ns = TRACED_NS

    def __init__(self, system: str, robot: IoRobot, axis: int, rings: Rings = present) -> None:
        """Attach and subscribe; SegmentError if it cannot be read."""
        super().__init__(system, robot.io.name, IO_STATE.name, kind="io", rings=rings)
        self._axis, self._robot = robot.axes.start + axis, robot.place
        # A recording does not have all records: each of its own is used.
        self._each = max(1, round(CLOSEST_S / robot.io.period_s)) if rings is present else 1

    def _shown(self, rows: NDArray[Any]) -> dict[str, Any]:
        rows = rows[rows["sequence"] % self._each == 0]
        columns = [rows[name][:, self._axis].astype(np.float32) for name in SIGNALS]
        for column in columns:  # no line while its boards are away: that is the last good value
            column[~rows["robot_valid"][:, self._robot]] = np.nan
        return {"t": [round(stamp * 1e-9, 4) for stamp in rows["stamp_ns"].tolist()], "v": columns}


def _number(reader: RingReader, entry: TopicEntry, path: FieldPath) -> FieldCells:
    reader.newest()
    cells = cells_of(entry, path, np.frombuffer(reader.record, reader.dtype))
    if cells.is_text or len(cells.labels) != 1:
        raise ValueError(f"{path.text} is not one number")
    if cells.labels[0] != path.text:  # one name for one number: pages share the source
        raise ValueError(f"{path.text} is called {cells.labels[0]}")
    return cells


def plot_of(document: SystemConfig, rings: Rings, name: str) -> Maker:
    """Factory for the source of a field path; ValueError if the path is invalid, or not one number."""
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
    return partial(PlotSource, document, entry, path, rings)
