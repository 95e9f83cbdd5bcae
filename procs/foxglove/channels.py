"""Foxglove channels for the topics of an instance: joints, poses and messages in its panels' formats, else JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from typing import Any, Final

import foxglove
import numpy as np
from foxglove import channels as fx
from foxglove.messages import JointState, JointStates, Log, LogLevel, Pose, PoseInFrame, Quaternion, Timestamp, Vector3

from trocar.procs.crtk.demand import Wanted
from trocar.procs.crtk.topics import EVENT, RECORD, TopicEntry
from trocar.procs.crtk.views import FLAGS, JS, OPERATING_STATE, STAMPS, OpenTopic, Stamps, frame_name
from trocar.shm.ring.ring import RingReader
from trocar.shm.system.events import ERROR, STATUS, WARNING

SECOND_NS: Final = 1_000_000_000
LEVELS: Final = {STATUS: LogLevel.Info, WARNING: LogLevel.Warning, ERROR: LogLevel.Error}
KINDS: Final = {"f": "number", "i": "integer", "u": "integer", "b": "boolean", "S": "string"}
STAMPED: Final = {"stamp_ns": {"type": "integer"}, "sequence": {"type": "integer"}}
NUMBERS: Final = {"type": "array", "items": {"type": "number"}}
PARTS: Final = {"cv": ("linear", "angular"), "cf": ("force", "torque")}


def timestamp(ns: int) -> Timestamp:
    """As Foxglove has it."""
    return Timestamp(*divmod(ns, SECOND_NS))


def pose_of(numbers: list[float]) -> Pose:
    """Of x y z qx qy qz qw."""
    x, y, z, *turn = numbers
    return Pose(position=Vector3(x=x, y=y, z=z), orientation=rotation_of(turn))


def rotation_of(turn: list[float]) -> Quaternion:
    """Of x y z w."""
    x, y, z, w = turn
    return Quaternion(x=x, y=y, z=z, w=w)


def schema_of(entry: TopicEntry) -> dict[str, Any]:
    """The JSON schema of the output of `OpenTopic.as_dict` for a topic."""
    known: dict[str, Any] = dict(STAMPED)
    if entry.kind == RECORD:
        known |= {field.name: _type_of(field.dtype) for field in entry.fields}
    elif entry.kind == EVENT:
        flag = FLAGS.get(entry.event)
        types = {field.name: _type_of(field.dtype) for field in entry.fields}
        known |= {name: types[name] for name in (*STAMPS, *(() if flag else OPERATING_STATE)) if name in types}
        known |= {flag: {"type": "boolean"}} if flag else {}
    else:
        known["valid"] = {"type": "boolean"}
        parts = PARTS.get(entry.kind, tuple(part for part, _ in entry.view.fields) if entry.view else ())
        dtypes = {part: field.dtype for (part, name) in (entry.view.fields if entry.view else ())
                  for field in entry.fields if field.name == name}
        known |= {part: _type_of(dtypes[part]) if part in dtypes else NUMBERS for part in parts}
    return {"type": "object", "title": f"trocar.{entry.name.replace('/', '.')}", "properties": known}


def _type_of(dtype: str) -> dict[str, Any]:
    form = np.dtype(dtype)
    shape = form.subdtype[1] if form.subdtype is not None else ()
    found: dict[str, Any] = {"type": KINDS.get(form.base.kind, "string")}
    for _ in shape:
        found = {"type": "array", "items": found}
    return found


class ShownTopic:
    """One topic and its channel. Invalid values are not published, except as JSON, which marks them."""

    def __init__(self, source: OpenTopic, frame: Callable[[], str]) -> None:
        entry = source.entry
        self.source, self._frame, self.is_wanted = source, frame, False
        self._message: Callable[[int], Any | None]
        self.channel: foxglove.Channel | fx.JointStatesChannel | fx.PoseInFrameChannel | fx.LogChannel
        if entry.kind == "js":
            self.channel, self._message = fx.JointStatesChannel(f"/{entry.name}"), self._joints
        elif entry.kind == "cp":
            self.channel, self._message = fx.PoseInFrameChannel(f"/{entry.name}"), self._pose
        elif entry.kind == EVENT and entry.event not in FLAGS and entry.event != "operating_state":
            self.channel, self._message = fx.LogChannel(f"/{entry.name}"), self._log
        else:
            self.channel = foxglove.Channel(f"/{entry.name}", schema=schema_of(entry), message_encoding="json")
            self._message = self._json

    def tell(self, stamps: Stamps) -> None:
        """The record last read."""
        ns = stamps.ns(self.source.stamp_ns)
        message = self._message(ns)
        if message is not None:
            self.channel.log(message, log_time=ns)

    def _joints(self, ns: int) -> JointStates | None:
        source = self.source
        if not source.valid:
            return None
        parts = {part: source.part(part).tolist() for part in JS}
        joints = [JointState(name=name, **{part: values[place] for part, values in parts.items()
                                           if place < len(values)})
                  for place, name in enumerate(source.labels())]
        return JointStates(timestamp=timestamp(ns), joints=joints)

    def _pose(self, ns: int) -> PoseInFrame | None:
        if not self.source.valid:
            return None
        numbers = self.source.part("pose").tolist()
        return PoseInFrame(timestamp=timestamp(ns), frame_id=self._frame(), pose=pose_of(numbers))

    def _log(self, ns: int) -> Log:
        row = self.source.as_dict()
        text = f"{row['text']}; {row['hint']}" if row["hint"] else row["text"]
        return Log(timestamp=timestamp(ns), level=LEVELS.get(row["severity"], LogLevel.Info), message=text,
                   name=row["component"] or self.source.entry.instance)

    def _json(self, ns: int) -> bytes:
        return json.dumps(self.source.as_dict(), allow_nan=False, separators=(",", ":")).encode()


class ShownRecords:
    """The topics of one ring: each is published only while it has a subscriber."""

    def __init__(self, demand: Wanted, ring: RingReader, entries: Iterable[TopicEntry]) -> None:
        self._demand, self._ring = demand, ring
        self.topics = [ShownTopic(OpenTopic(demand.system, entry, ring), frame_name(entry, ring)) for entry in entries]
        self._sequence = 0

    def look(self) -> None:
        """Subscribe to the topics with subscribers now, and to nothing else."""
        for topic in self.topics:
            if topic.channel.has_sinks() is not topic.is_wanted:
                topic.is_wanted, self._sequence = not topic.is_wanted, 0
                (self._demand.take if topic.is_wanted else self._demand.leave)(topic.source.entry)

    def step(self, stamps: Stamps) -> None:
        """The newest record, once."""
        wanted = [topic for topic in self.topics if topic.is_wanted]
        if wanted and self._ring.newest() and self._ring.sequence != self._sequence:
            self._sequence = self._ring.sequence
            for topic in wanted:
                topic.tell(stamps)


class ShownEvents:
    """The events of one instance: each is published; a new subscriber gets the last earlier one."""

    def __init__(self, system: str, ring: RingReader, entries: Iterable[TopicEntry]) -> None:
        self._ring, self._event = ring, ring.field("event")
        shown = [ShownTopic(OpenTopic(system, entry, ring), str) for entry in entries]
        self._topics = {topic.source.entry.event.encode(): topic for topic in shown}
        self._begun = {f"/{topic.source.entry.name}": topic for topic in shown}

    def listens(self, name: str, stamps: Stamps) -> bool:
        """A channel has a new subscriber; returns whether it is one of these."""
        topic = self._begun.get(name)
        if topic is not None and topic.source.newest():
            topic.tell(stamps)
        return topic is not None

    def step(self, stamps: Stamps) -> None:
        """All events since the last call."""
        while self._ring.next():
            topic = self._topics.get(self._event.item())
            if topic is not None and topic.channel.has_sinks():
                topic.tell(stamps)
