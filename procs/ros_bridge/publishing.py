"""What the records of an instance become in ROS: its views, its events, and fields that are told when they change."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from procs.crtk.frames import frame_name
from procs.crtk.plain import plain
from procs.crtk.stamps import Stamps
from procs.crtk.topics import TopicEntry
from procs.crtk.views import OpenTopic
from procs.ros.dds import LATCHED, Participant, TopicWriter
from procs.ros.messages import JointStates, Log, OperatingState, String
from procs.ros_bridge.outgoing import EVENT_MESSAGES, NOT_OF_ARMS, VIEW_MESSAGES, EventMessage, FieldTopic, ViewMessage
from procs.ros_bridge.packing import PackedMessage
from procs.ros_bridge.stamps import SECOND_NS, time_of
from shm.events import ERROR, STATUS, WARNING
from shm.ring import RingReader
from shm.subscriptions import Subscriber

UNSUITABLE: Final = str.maketrans(" -.()[]", "_" * 7)
LEVELS: Final = {STATUS: 20, WARNING: 30, ERROR: 40}
"""Of /rosout."""
REPEAT_NS: Final = 100_000_000
"""Between two messages of an operating state: who comes late has to hear it."""


def ros_topic(name: str) -> str:
    """A name as ROS allows it."""
    return name.translate(UNSUITABLE)


class PublishedView:
    """One view while somebody reads it."""

    def __init__(self, source: OpenTopic, writer: TopicWriter[Any], row: ViewMessage, frame: Callable[[], str]) -> None:
        self.source, self.writer, self.is_wanted = source, writer, False
        self._parts, self._frame, self._packed = row.parts, frame, PackedMessage(row.message, row.put)
        self._has_joints = row.message is JointStates
        self._texts: tuple[bytes, str] = b"?", ""

    def publish(self, stamps: Stamps) -> None:
        """The record last read; a stamp of 0 says that it is not valid."""
        source, packed = self.source, self._packed
        texts = source.part("name").tobytes() if self._has_joints else b"", self._frame()
        if texts != self._texts:
            self._texts = texts
            self._name(packed.message)
        blocks = [np.asarray(source.part(part), dtype=np.float64).ravel() for part in self._parts]
        stamp_ns = stamps.ns(source.stamp_ns) if source.valid and source.stamp_ns else 0
        packed.pack(texts, blocks, divmod(stamp_ns, SECOND_NS))
        self.writer.write(packed.carrier)

    def _name(self, message: Any) -> None:
        if self._has_joints:
            message.name = self.source.labels()
        if hasattr(message, "header"):
            message.header.frame_id = self._texts[1]


class RecordTopics:
    """The views and told fields of one ring."""

    def __init__(self, participant: Participant, system: str, prefix: str, ring: RingReader,
                 entries: Iterable[TopicEntry], told: Iterable[FieldTopic]) -> None:
        """`prefix` is that of the instance's topics; `told` are those of its kind."""
        self._system, self._ring = system, ring
        self._subscriber: Subscriber | None = None
        self.views = [self._view(participant, entry) for entry in entries
                      if entry.kind in VIEW_MESSAGES and entry.name.partition("/")[2] not in NOT_OF_ARMS]
        self._told = [(row, ring.field(row.field), participant.writer(f"{prefix}/{row.topic}", row.message, LATCHED))
                      for row in told]
        self._seen = [b""] * len(self._told)
        self._selections = Selections(participant, prefix, ring) if "selected" in (ring.dtype.names or ()) else None

    def _view(self, participant: Participant, entry: TopicEntry) -> PublishedView:
        row = VIEW_MESSAGES[entry.kind]
        writer: TopicWriter[Any] = participant.writer(ros_topic(entry.name), row.message)
        return PublishedView(OpenTopic(self._system, entry, self._ring), writer, row, frame_name(entry, self._ring))

    def look(self) -> None:
        """Ask for what somebody reads now, and for nothing else."""
        for view in self.views:
            if view.writer.is_read is not view.is_wanted:
                view.is_wanted = view.writer.is_read
                self._want(view)

    def _want(self, view: PublishedView) -> None:
        entry = view.source.entry
        if self._subscriber is None:
            self._subscriber = Subscriber(self._system, entry.instance, "ros_bridge")
        if view.is_wanted:
            self._subscriber.want(entry.ring, *view.source.groups)
        elif view.source.groups:
            self._subscriber.drop(entry.ring, *view.source.groups)
        if not any(other.is_wanted for other in self.views):
            self._subscriber.drop(entry.ring)

    def step(self, stamps: Stamps) -> None:
        """The newest record to whoever reads it; what was told before only where it has changed."""
        wanted = [view for view in self.views if view.is_wanted]
        if not wanted and not self._told:
            return
        is_there = self._ring.newest()
        if self._selections is not None and is_there:
            self._selections.step()
        for view in wanted:
            view.publish(stamps)
        for place, (row, cell, writer) in enumerate(self._told if is_there else ()):
            value = cell.tobytes()
            if value != self._seen[place]:
                self._seen[place] = value
                writer.write(row.of(cell))

    def close(self) -> None:
        """Nothing is wanted any more."""
        if self._subscriber is not None:
            self._subscriber.close()
        self._ring.close()


class Selections:
    """Which teleoperations a console has selected: each by its name, when that changes; late comers hear of all."""

    def __init__(self, participant: Participant, prefix: str, ring: RingReader) -> None:
        """`ring` is the console's, read by its `RecordTopics`."""
        self._names, self._selected = ring.field("teleop"), ring.field("selected")
        self._seen: list[tuple[str, bool]] = []
        self._writers = {flag: participant.writer(f"{prefix}/teleop/{word}", String, max(1, len(self._names)))
                         for flag, word in ((True, "selected"), (False, "unselected"))}

    def step(self) -> None:
        """After the record was read."""
        now = [(str(plain(name)), flag) for name, flag in
               zip(self._names.tolist(), self._selected.tolist(), strict=True)]
        for name, flag in now:
            if name and (name, flag) not in self._seen:
                self._writers[flag].write(String(name))
        self._seen = now


@dataclass(slots=True)
class ToldState:
    """The operating state told last; its stamps increase strictly, as clients compare them."""

    writer: TopicWriter[OperatingState]
    message: OperatingState
    stamp_ns: int = 0
    due_ns: int = 0

    def tell(self, ros_ns: int, now_ns: int) -> None:
        """Once more, or anew. The time of day may be set back: stamps are not, nor does anybody wait for it."""
        self.stamp_ns = max(ros_ns, self.stamp_ns + 1)
        self.due_ns = now_ns + REPEAT_NS
        self.message.header.stamp = time_of(self.stamp_ns)
        self.writer.write(self.message)


class EventTopics:
    """The events of one instance, in the order in which they came."""

    def __init__(self, participant: Participant, prefix: str, ring: RingReader, entries: Iterable[TopicEntry],
                 rosout: Callable[[Log], None]) -> None:
        self._ring, self._name, self._rosout = ring, prefix.replace("/", "."), rosout
        self._fields = {name: ring.field(name) for name in ring.dtype.names or () if name not in ("sequence",)}
        self._rows: dict[bytes, tuple[EventMessage, TopicWriter[Any]]] = {}
        self.state: ToldState | None = None
        for entry in entries:
            row = EVENT_MESSAGES.get(entry.event)
            if row is None:
                continue
            writer: TopicWriter[Any] = participant.writer(ros_topic(f"{prefix}/{entry.event}"), row.message, LATCHED)
            self._rows[entry.event.encode()] = row, writer
            if row.message is OperatingState:
                self.state = ToldState(writer, OperatingState())

    def begin(self, state: str, is_homed: bool, is_busy: bool) -> None:
        """The operating state there is before the first event of it."""
        if self.state is not None:
            self.state.message = OperatingState(state=state, is_homed=is_homed, is_busy=is_busy)

    def step(self, stamps: Stamps, now_ns: int) -> None:
        """All that came since the last call; none is left out or put together with the next."""
        fields, ring = self._fields, self._ring
        while ring.next():
            event = {name: cell[()] for name, cell in fields.items()}
            self._tell(event, stamps.ns(ring.stamp_ns), now_ns)
            if event["severity"]:
                self._log(event, stamps.ns(ring.stamp_ns))
        if self.state is not None and now_ns >= self.state.due_ns:
            self.state.tell(stamps.ns(now_ns), now_ns)

    def _tell(self, event: dict[str, Any], ros_ns: int, now_ns: int) -> None:
        row, writer = self._rows.get(bytes(event["event"]), (None, None))
        if row is None or writer is None:
            return
        message = row.of(event)
        if self.state is not None and writer is self.state.writer:
            self.state.message = message
            self.state.tell(ros_ns, now_ns)
        else:
            if hasattr(message, "header"):
                message.header.stamp = time_of(ros_ns)
            writer.write(message)

    def _log(self, event: dict[str, Any], ros_ns: int) -> None:
        text, hint = (bytes(event[name]).rstrip(b"\0").decode(errors="replace") for name in ("text", "hint"))
        level = LEVELS.get(int(event["severity"]), LEVELS[STATUS])
        self._rosout(Log(time_of(ros_ns), level, self._name, f"{text}; {hint}" if hint else text))

    def close(self) -> None:
        """Unmap."""
        self._ring.close()
