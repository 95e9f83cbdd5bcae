"""Topics by name: whole records (PSM1/state), CRTK views (PSM1/measured_js), events (PSM1/error).

The catalogue is read from shared memory, where the header of each ring describes its records; `shm/topics.py` defines
which CRTK names are views on which fields.
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass, field
from typing import Any

from trocar.procs.crtk.names import Unknown, none_such
from trocar.procs.tables.arm_types import ARM_TYPES
from trocar.procs.tables.manifest import PROCS
from trocar.shm.memory.segment import Segment, SegmentError, segment_name
from trocar.shm.system.directory import rings, topic_of
from trocar.shm.topics import Field, View

EVENTS_OF_ALL = ("status", "warning", "error")
SEEN_OF_SOME = {view for row in ARM_TYPES.values() for view in row.views}  # of arms of some types
RECORD, EVENT = "record", "event"
ONE_JOINT = ("jaw", "gripper")


@dataclass(frozen=True, slots=True)
class TopicEntry:
    """One topic: its ring, and its view on the records.

    `kind` is record, event, or the payload of a view. `first` and `count` select a robot's part of arrays over all
    axes; for a setup arm, `row` is its index, and `count` its number of joints. `problem`: the writer is gone, or the
    reason why it cannot be read; empty without problem. `simulation` is KINEMATIC without a robot. `frame`: that of its
    values, if it is not the instance's own.
    """

    name: str
    instance: str
    ring: str
    kind: str
    rate_hz: float
    fields: tuple[Field, ...] = ()
    view: View | None = None
    event: str = ""
    robot: str = ""
    first: int = 0
    count: int = 0
    row: int = -1
    labels: tuple[str, ...] = field(default=())
    problem: str = ""
    simulation: str = ""
    frame: str = ""

    @property
    def groups(self) -> tuple[str, ...]:
        """Its groups of fields that are computed on demand (shm/system/subscriptions.py)."""
        return tuple(dict.fromkeys(row.group for row in self.fields if row.group))

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of its joints, if its records do not have them."""
        part = self.name.rsplit("/", 2)[-2]
        return self.labels or ((part,) if part in ONE_JOINT else ())


def catalogue(system: str) -> list[TopicEntry]:
    """All topics of a system, instance by instance: records, then views, then events."""
    found: list[TopicEntry] = []
    for instance, ring in rings(system):
        found += _entries(system, instance, ring)
    return found


def find(system: str, topic: str) -> TopicEntry:
    """The topic of this name; otherwise Unknown, with similar names."""
    entries = catalogue(system)
    for entry in entries:
        if entry.name == topic:
            return entry
    raise Unknown(none_such("topic", topic, [entry.name for entry in entries]))


def _entries(system: str, instance: str, ring: str) -> list[TopicEntry]:
    try:
        with Segment(segment_name(system, instance, ring)) as segment:
            gone = segment.gone
            entries = _described(instance, ring, segment.header.info, segment.header.schema.text)
            simulation = str(segment.header.info.get("simulation", ""))
    except SegmentError as error:
        return [TopicEntry(f"{instance}/{ring}", instance, ring, RECORD, 0.0, problem=str(error))]
    except (ValueError, KeyError, TypeError, AttributeError) as error:  # a header may say anything
        text = f"its header is invalid ({type(error).__name__}: {error})"
        return [TopicEntry(f"{instance}/{ring}", instance, ring, RECORD, 0.0, problem=text)]
    return [dataclasses.replace(entry, problem=writer_gone(gone), simulation=simulation) for entry in entries]


def writer_gone(who: str) -> str:
    """The problem of a ring whose writer `who` is gone; empty while the writer lives."""
    return f"its writer {who} is gone" if who else ""


def _described(instance: str, ring: str, info: dict[str, Any], text: bytes) -> list[TopicEntry]:
    rate = float(info.get("rate_hz", 0.0))
    fields = tuple(_field(row) for row in json.loads(text)["fields"])
    known = {f.name: f for f in fields}
    kind, own = str(info.get("kind", "")), ARM_TYPES.get(str(info.get("type", "")))
    record = TopicEntry(f"{instance}/{ring}", instance, ring, RECORD, rate, fields)
    if ring == "events":
        reported = next((row.events for row in PROCS if row.kind == kind), ())
        reported += (own.events if own is not None else ()) + EVENTS_OF_ALL
        return [record] + [TopicEntry(f"{instance}/{name}", instance, ring, EVENT, 0.0, fields,
                                      event=name) for name in reported]
    try:
        views = topic_of(kind, ring).views
    except KeyError:
        views = ()
    found = [record]
    for view in views:
        seen = tuple(known[name] for _, name in view.fields if name in known)
        if len(seen) < len(view.fields):  # another version's record
            continue
        what = view.name.partition("/")[0]
        if own is not None and what in SEEN_OF_SOME and what not in own.views:
            continue
        if view.per:
            found += _of_each(view, instance, ring, rate, seen, dict(info.get(f"{view.per}s", {})))
        else:
            found.append(TopicEntry(f"{instance}/{view.name}", instance, ring, view.kind, rate, seen, view))
    return found


def _of_each(
    view: View, instance: str, ring: str, rate: float, seen: tuple[Field, ...], parts: dict[str, Any]
) -> list[TopicEntry]:
    """A view for every robot, or every setup arm."""
    found = []
    for robot, cut in parts.items():
        labels = tuple(str(label) for label in cut.get("names", ()))
        found.append(TopicEntry(f"{instance}/{robot}/{view.name}", instance, ring, view.kind, rate, seen, view,
                                robot=robot,
                                first=int(cut.get("first", 0)), count=int(cut["count"]), row=int(cut.get("row", -1)),
                                labels=labels))
    return found


def _field(row: dict[str, Any]) -> Field:
    return Field(str(row["name"]), str(row["dtype"]), str(row.get("unit", "")), str(row.get("text", "")),
                 str(row.get("group", "")))
