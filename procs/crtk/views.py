"""Reading any topic by its name: used by bridges, `echo`, `attach` and scripts.

    with OpenTopic(system, find(system, "PSM1/measured_js")) as source:
        if source.newest():
            source.stamp_ns, source.valid, source.part("position"), source.as_dict()
"""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.crtk.plain import plain
from trocar.procs.crtk.topics import EVENT, RECORD, TopicEntry, writer_gone
from trocar.procs.tables.arm_types import base_name
from trocar.shm.memory.closable import Closable
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.time.clock import local_ns, monotonic_ns
from trocar.shm.time.system_time import SystemTime

FLAGS = {"goal_reached": "reached", "arm_clutch": "pressed", "gripper/closed": "closed", "orientation_locked": "locked"}
OPERATING_STATE = ("state", "sub_state", "is_homed", "is_busy")
MESSAGE = ("severity", "code", "component", "axis", "board", "value", "limit", "text", "hint")
STAMPS = ("stamp_ns", "sequence", "monotonic_ns", "local_ns")
JS = ("position", "velocity", "effort")
NEEDED_FIRST = ("valid", "cartesian_valid", "reference_valid")
"""Flags of arms: each requires the preceding ones."""

READING_NS: Final = 1_000_000
"""Two clocks read one after the other may differ by this much more than before, on a busy machine."""


class OpenTopic(Closable):
    """One topic, open for reading; a context manager."""

    def __init__(self, system: str, entry: TopicEntry, reader: RingReader | None = None) -> None:
        """Attach to the ring of `entry`, or use the records that `reader` of that ring reads."""
        self.entry = entry
        self._reader: RingReader = reader or directory.reader(system, entry.instance, entry.ring, often=False)
        self.system = system
        self._time: SystemTime | None = None  # opened at the first use of `age_s`: most topics do not need the clock
        self._names = [n for n in self._reader.dtype.names or () if n not in ("sequence", "stamp_ns")]
        self._fields = {name: self._reader.field(name) for name in self._names}
        self.groups = entry.groups
        self._on_demand = [row.name for row in entry.fields if row.group]

    @property
    def stamp_ns(self) -> int:
        """Monotonic stamp of the record last read."""
        return self._reader.stamp_ns

    @property
    def age_s(self) -> float:
        """Age of the record last read, in the system's time."""
        if self._time is None:
            self._time = SystemTime(self.system)
        return (self._time.now_ns() - self.stamp_ns) * 1e-9

    @property
    def sequence(self) -> int:
        """Number of the record last read."""
        return self._reader.sequence

    @property
    def head(self) -> int:
        """Number of the newest record; 0 if there is none."""
        return self._reader.head

    @property
    def lost(self) -> int:
        """Number of records that were overwritten before `next` read them."""
        return self._reader.lost

    def problem(self) -> str:
        """The problem of the ring: its writer is gone, or its records are damaged; empty if there is none."""
        reported = [writer_gone(self._reader.gone), self._reader.problem]
        return "; ".join(part for part in reported if part)

    def newest(self) -> bool:
        """Read the newest record, or the last event of this name; False when there is none."""
        if self.entry.kind != EVENT:
            return self._reader.newest()
        return self._reader.newest() and self._back_to_ours()

    def next(self) -> bool:
        """Read the next record in order, or the next event of this name; False when there is none yet."""
        while self._reader.next():
            if self.entry.kind != EVENT or self._is_ours():
                return True
        return False

    def history(self, count: int) -> list[dict[str, Any]]:
        """The newest records kept, oldest first, as plain values."""
        rows = self._reader.last(count)
        return [{name: plain(row[name]) for name in self._reader.dtype.names or ()} for row in rows]

    def rows_since(self, seconds: float, count: int) -> list[NDArray[Any]]:
        """Up to `count` records of the last `seconds`, evenly spread, oldest first, each in the form of `record`."""
        rows = self._reader.since(self.stamp_ns - round(seconds * 1e9))
        places = sorted({round(place) for place in np.linspace(0, len(rows) - 1, min(count, len(rows))).tolist()})
        return [rows[place : place + 1] for place in places]

    def kept(self, count: int) -> list[dict[str, Any]]:
        """The newest events of this name in the ring, oldest first; of all names for the topic `events`."""
        rows = self.history(1 << 20)
        ours = [row for row in rows if self.entry.kind != EVENT or row["event"] == self.entry.event]
        return ours[-count:] if count else ours

    def as_row(self) -> dict[str, Any]:
        """The record last read, with all fields."""
        head = {"stamp_ns": self.stamp_ns, "sequence": self.sequence}
        return head | {name: plain(self._fields[name]) for name in self._names}

    def _is_ours(self) -> bool:
        return bool(plain(self._fields["event"].item()) == self.entry.event)

    def _back_to_ours(self) -> bool:
        if self._is_ours():
            return True
        kept = self._reader.last(1 << 20)
        ours = np.flatnonzero(kept["event"] == self.entry.event.encode())
        if not len(ours):
            return False
        record = kept[ours[-1]]
        for name, cell in self._fields.items():
            cell[...] = record[name]
        self._reader.field("stamp_ns")[...] = record["stamp_ns"]
        self._reader.sequence = int(record["sequence"])
        return True

    @property
    def valid(self) -> bool:
        """Whether the values of the record are valid."""
        flag = self._fields.get(self.entry.view.where if self.entry.view else "valid")
        return True if flag is None else bool(flag[self.entry.row] if self.entry.row >= 0 else flag[()])

    @property
    def why_invalid(self) -> str:
        """The missing condition for valid values, with state and reason of the instance; empty if they are valid."""
        if self.valid:
            return ""
        flag = (self.entry.view.where if self.entry.view else "") or "valid"
        chain = NEEDED_FIRST[: NEEDED_FIRST.index(flag) + 1] if flag in NEEDED_FIRST else (flag,)
        false = next(name for name in chain if name in self._fields and (name == flag or not self._fields[name].all()))
        texts = {row["name"]: str(row["text"]) for row in json.loads(self._reader.schema.text)["fields"]}
        meaning = texts[false].partition("; false:")[0]
        reported = [f"needed: {meaning.partition(': ')[2] or meaning}"]
        for name, words in (("state", f"{self.entry.instance} is "), ("reason", "")):
            if name in self._fields and (text := str(plain(self._fields[name].item()))):
                reported.append(words + text)
        return "; ".join(reported)

    @property
    def is_computed(self) -> bool:
        """Whether all values on demand are computed; also True for an invalid record, where that is unknown."""
        return not self.valid or not any(
            np.isnan(self._cut(np.atleast_1d(self._fields[name]))).any() for name in self._on_demand)

    @property
    def record(self) -> NDArray[Any]:
        """The record last read as stored in the ring, (1,), with named fields; it changes at the next read."""
        return np.frombuffer(self._reader.record, self._reader.dtype)

    def part(self, name: str) -> NDArray[Any]:
        """A part of a view (position, velocity, pose…) as a new array, cut to the joints in use; empty if missing."""
        view = self.entry.view
        where = dict(view.fields).get(name) if view is not None else name
        if where is None:
            return np.zeros(0)
        return self._cut(np.atleast_1d(self._fields[where]))

    def value(self, field: str) -> Any:
        """A field of the record, as a plain value."""
        return plain(self._fields[field])

    def _cut(self, value: NDArray[Any]) -> NDArray[Any]:
        if self.entry.row >= 0:
            of_joints = self.entry.kind == "js"
            return value[self.entry.row, : self.entry.count if of_joints else None].copy()
        if self.entry.count:
            return value[self.entry.first : self.entry.first + self.entry.count].copy()
        if value.shape[-1] == 8 and "count" in self._fields:  # an arm's record has room for 8 joints
            return value[..., : int(self._fields["count"][()])].copy()
        return value.copy()

    def labels(self) -> list[str]:
        """Joint names of a view."""
        return list(self.entry.joint_names) or [str(plain(name)) for name in self.part("name").tolist()]

    def as_dict(self) -> dict[str, Any]:
        """The record for JSON; values that are invalid or not finite are None."""
        head = {"stamp_ns": self.stamp_ns, "sequence": self.sequence}
        if self.entry.kind == RECORD:
            return head | {name: plain(self._fields[name]) for name in self._names}
        if self.entry.kind == EVENT:
            return event_as_dict(self.entry.event, self.as_row())
        return head | {"valid": self.valid} | self._view()


    def _view(self) -> dict[str, Any]:
        kind, valid = self.entry.kind, self.valid

        def value(array: NDArray[Any]) -> Any:
            return plain(array) if valid else None

        if kind == "js":
            return {"name": self.labels()} | {part: value(self.part(part)) for part in JS}
        if kind == "cp":
            pose = self.part("pose")
            return {"position": value(pose[:3]), "orientation": value(pose[3:])}
        if kind == "cv":
            twist = self.part("twist")
            return {"linear": value(twist[:3]), "angular": value(twist[3:])}
        if kind == "cf":
            wrench = self.part("wrench")
            return {"force": value(wrench[:3]), "torque": value(wrench[3:])}
        return {part: value(self.part(part)) for part, _ in self.entry.view.fields} if self.entry.view else {}

    def close(self) -> None:
        """Unmap."""
        if self._time is not None:
            self._time.close()
        self._reader.close()


def event_as_dict(name: str, row: dict[str, Any]) -> dict[str, Any]:
    """An event of this name for JSON, with its own fields and stamps; a missing axis or board is None."""
    stamps = {key: row[key] for key in STAMPS if key in row}
    if name in FLAGS and "value" in row:
        return stamps | {FLAGS[name]: bool(row["value"])}
    shown = OPERATING_STATE if name == "operating_state" else MESSAGE
    found = {key: row[key] for key in shown}
    return stamps | found | {key: None for key in ("axis", "board") if found.get(key) == -1}


def state_as_event(system: str, state: TopicEntry) -> dict[str, Any] | None:
    """An operating_state from the state record, for an arm without such an event in its ring."""
    if {f.name for f in state.fields} >= set(OPERATING_STATE):
        with OpenTopic(system, state) as source:
            if source.newest():
                record = source.as_dict()
                known = {key: record[key] for key in ("stamp_ns", "sequence", *OPERATING_STATE)}
                return known | {"event": "operating_state", "component": "", "severity": 0, "monotonic_ns": 0,
                                "local_ns": 0}
    return None


def frame_name(entry: TopicEntry, ring: RingReader) -> Callable[[], str]:
    """A function for the frame of a view on `ring`: a fixed name, or that in the record last read; empty: no frame."""
    what = entry.name.removeprefix(f"{entry.instance}/")
    base = "Cart" if entry.row >= 0 else base_name(entry.instance)
    of_name = base if "local/" in what or what.startswith("spatial/") else entry.instance if "body/" in what else ""
    fixed = entry.frame or of_name
    if fixed or entry.kind not in ("cp", "cv") or "reference_frame" not in (ring.dtype.names or ()):
        return lambda: fixed
    cell = ring.field("reference_frame")
    cell = cell[entry.row : entry.row + 1].reshape(()) if entry.row >= 0 else cell
    return lambda: str(plain(cell.item()))


class Stamps:
    """Converts stamps of records for other programs: to the time of day, or unchanged if time is simulated.

    The offset between the clocks is that of the last `look`.
    """

    def __init__(self, simulated: bool) -> None:
        self.simulated = simulated
        self._ahead_ns = 0
        self.look()

    def look(self) -> None:
        """Measure the offset between time of day and the clock of stamps; the former may be set at any time.

        A difference of a few µs is that of two readings: the same record keeps its stamp, and none is earlier than the
        one before.
        """
        ahead_ns = 0 if self.simulated else local_ns() - monotonic_ns()
        if abs(ahead_ns - self._ahead_ns) > READING_NS:
            self._ahead_ns = ahead_ns

    def ns(self, stamp_ns: int) -> int:
        """Convert a record's stamp, ns."""
        return stamp_ns + self._ahead_ns
