"""ROS messages from the records of an instance: its views, and fields that are published when they change."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, Final

from numpy.typing import NDArray

from trocar.procs.crtk.demand import Wanted
from trocar.procs.crtk.plain import plain
from trocar.procs.crtk.topics import TopicEntry
from trocar.procs.crtk.views import OpenTopic, Stamps, frame_name
from trocar.procs.ros_bridge.outgoing import OF_FIELD, FieldTopic, stamped
from trocar.procs.ros_messages.dds import LATCHED, Participant, TopicWriter
from trocar.procs.ros_messages.messages import String
from trocar.procs.ros_messages.packed_view import PackedView
from trocar.procs.ros_messages.view_messages import VIEW_MESSAGES
from trocar.shm.ring.ring import RingReader

UNSUITABLE: Final = str.maketrans(" -.()[]", "_" * 7)


def ros_topic(name: str) -> str:
    """A name as ROS allows it."""
    return name.translate(UNSUITABLE)


class PublishedView:
    """One view while it has readers."""

    def __init__(self, source: OpenTopic, writer: TopicWriter[Any], frame: Callable[[], str]) -> None:
        self.source, self.writer, self.is_wanted = source, writer, False
        self._packed = PackedView(source, frame)

    def publish(self, stamps: Stamps) -> None:
        """The record last read; a stamp of 0 marks it as invalid."""
        self._packed.pack(stamps.ns(self.source.stamp_ns))
        self.writer.write(self._packed.carrier)


class RecordTopics:
    """The views and published fields of one ring."""

    def __init__(self, participant: Participant, demand: Wanted, instance: str, ring: RingReader,
                 views: Iterable[tuple[TopicEntry, str]], told: Iterable[tuple[FieldTopic, str, int]]) -> None:
        """Views with their topics; fields published on change, with topic and index (see shown.py)."""
        self._demand, self._ring = demand, ring
        self.views = [self._view(participant, entry, name) for entry, name in views]
        self._wanted: list[PublishedView] = []
        self._told = [(row, _cell(ring, row.field, place), participant.writer(ros_topic(name), row.message, LATCHED))
                      for row, name, place in told]
        self._seen = [b""] * len(self._told)
        self._selections = Selections(participant, instance, ring) if "selected" in (ring.dtype.names or ()) else None

    def _view(self, participant: Participant, entry: TopicEntry, name: str) -> PublishedView:
        writer: TopicWriter[Any] = participant.writer(ros_topic(name), VIEW_MESSAGES[entry.kind].message)
        return PublishedView(OpenTopic(self._demand.system, entry, self._ring), writer, frame_name(entry, self._ring))

    def look(self) -> None:
        """Subscribe to the data with readers now, and to nothing else."""
        for view in self.views:
            if view.writer.is_read is not view.is_wanted:
                view.is_wanted = view.writer.is_read
                self._wanted = [each for each in self.views if each.is_wanted]
                (self._demand.take if view.is_wanted else self._demand.leave)(view.source.entry)

    def step(self, stamps: Stamps) -> None:
        """The newest record to its readers; fields published on change only if they have changed."""
        if not self._wanted and not self._told:
            return
        is_there = self._ring.newest()
        if self._selections is not None and is_there:
            self._selections.step()
        for view in self._wanted:
            view.publish(stamps)
        for place, (row, cell, writer) in enumerate(self._told if is_there else ()):
            value = cell.tobytes()
            if value != self._seen[place]:
                self._seen[place] = value
                writer.write(stamped(OF_FIELD[row.message](cell), stamps.ns(self._ring.stamp_ns)))


def _cell(ring: RingReader, name: str, place: int) -> NDArray[Any]:
    field = ring.field(name)
    return field if place < 0 else field[place : place + 1].reshape(())


class Selections:
    """Teleoperations selected by a console: each by its name, on change; late subscribers get all."""

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
