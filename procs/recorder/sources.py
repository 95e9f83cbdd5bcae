"""Sources of recordings: records of rings, CRTK's views on them, and the time of day of each record."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.crtk.plain import plain
from trocar.procs.crtk.topics import EVENT, RECORD, TopicEntry, catalogue
from trocar.procs.crtk.views import OpenTopic, frame_name
from trocar.procs.node.node import NodeClock
from trocar.procs.recordings import names
from trocar.procs.recordings.chunks import Chunk
from trocar.procs.recordings.layout import ENCAPSULATION
from trocar.procs.recordings.writing import ChannelTable
from trocar.procs.ros_messages import cdr
from trocar.procs.ros_messages.definitions import definition
from trocar.procs.ros_messages.hashes import ros_name
from trocar.procs.ros_messages.messages import LOG_LEVELS, Log, log_line
from trocar.procs.ros_messages.packed_view import PackedView
from trocar.procs.ros_messages.view_messages import VIEW_MESSAGES
from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.time.clock import local_ns, monotonic_ns

COMPLETE: Final = ("events", "audit")
"""Rings of which every record is kept, beginning with the oldest available."""
VIEWS: Final = ("measured_js", "setpoint_js", "measured_cp", "setpoint_cp", "local/setpoint_cp", "jaw/measured_js",
                "jaw/setpoint_js", "gripper/measured_js")
"""Views of arms that are recorded by default; dVRK's bag replay reads the setpoints."""


class LocalTimes:
    """Converts stamps of records, in real or simulated time, to the time of day.

    Valid between two calls of `look`, when both clocks are read.
    """

    def __init__(self, time: NodeClock) -> None:
        self._time = time
        self.system_ns = self._since_ns = time.now_ns()
        self.monotonic_ns = monotonic_ns()
        self.local_ns = self._since_local_ns = local_ns()

    def look(self) -> None:
        """Read all clocks."""
        self._since_ns, self._since_local_ns = self.system_ns, self.local_ns
        self.system_ns, self.monotonic_ns, self.local_ns = self._time.now_ns(), monotonic_ns(), local_ns()

    @property
    def now(self) -> tuple[int, int]:
        """Real and system time, for `passed_ns`."""
        return self.monotonic_ns, self.system_ns

    def passed_ns(self, since: tuple[int, int]) -> int:
        """Time since an earlier `now`; of simulated and real time, the one that has passed faster."""
        real_ns, system_ns = self.monotonic_ns - since[0], self.system_ns - since[1]
        return max(real_ns, system_ns) if self._time.simulated else real_ns

    def of(self, stamp_ns: int) -> int:
        """Time of day of a stamp; for simulated time, interpolated between the last two looks."""
        behind, passed = self.system_ns - stamp_ns, self.system_ns - self._since_ns
        if self._time.simulated and 0 < behind <= passed:
            behind = behind * (self.local_ns - self._since_local_ns) // passed
        return max(0, self.local_ns - behind)


class RecordedRing:
    """One ring with its channels; each recording has its own reader."""

    def __init__(self, system: str, instance: str, ring: str, table: ChannelTable) -> None:
        """SegmentError or LayoutError when the ring cannot be read."""
        self.system, self.instance, self.ring = system, instance, ring
        self.topic, self._table = f"{instance}/{ring}", table
        self.sampler = self.reader()
        info = self.sampler.info
        self.kind, self._info = str(info.get("kind", "")), info
        self.rate_hz = float(info.get("rate_hz") or 0.0)
        self._epoch, self._channel, self._size = -1, 0, 0
        self._seen = 0
        self.is_complete = ring in COMPLETE or not self.rate_hz
        self.is_seldom = self.is_complete and ring not in COMPLETE
        """Whether it is written only at changes: then its newest record is the present state."""
        self._log = MessageLog(instance, table) if ring == "events" else None
        self.begin()
        if self.is_complete:
            self.sampler.rewind()

    def reader(self, often: bool = False) -> RingReader:
        """Another reader of the ring, from now on."""
        return directory.reader(self.system, self.instance, self.ring, often=often)

    def begin(self) -> None:
        """Set up the channel for the present writer."""
        self._epoch, schema = self.sampler.epoch, self.sampler.schema
        self._channel, layout = self._table.ring(self.instance, self.ring, self.kind, schema, self._epoch, self._info)
        self._size = layout.size

    @property
    def depth_s(self) -> float:
        """Time span of the ring, s; 0 without a rate."""
        return self.sampler.depth / self.rate_hz if self.rate_hz else 0.0

    def keep(self, chunk: Chunk, reader: RingReader, times: LocalTimes, since_ns: int = 0) -> None:
        """Add the record read last; if it is older than `since_ns` (time of day), with that time."""
        if reader.epoch != self._epoch:
            self.begin()
        stamp = reader.stamp_ns
        chunk.add(self._channel, reader.sequence, max(since_ns, times.of(stamp)), max(0, stamp), ENCAPSULATION,
                  reader.record[: self._size])
        if self._log is not None:
            self._log.keep(chunk, reader, times)

    def sample(self, chunk: Chunk, times: LocalTimes) -> None:
        """Add the newest record, if there is a new one."""
        if self.sampler.head != self._seen and self.sampler.newest():
            self._seen = self.sampler.sequence
            self.keep(chunk, self.sampler, times)

    def keep_newest(self, chunk: Chunk, times: LocalTimes) -> None:
        """Add the newest record again, with the present time."""
        reader = self.reader()
        if reader.newest():
            self.keep(chunk, reader, times, times.local_ns)
        reader.close()

    def drain(self, reader: RingReader, chunk: Chunk, times: LocalTimes, most: int, since_ns: int = 0) -> int:
        """Add the records since the last call, at most `most`; returns their number."""
        count = 0
        while count < most and reader.next():
            self.keep(chunk, reader, times, since_ns)
            count += 1
        return count

    def copy(self) -> NDArray[Any]:
        """All records in the ring, oldest first, for `keep_copied`."""
        if self.sampler.epoch != self._epoch:
            self.begin()
        return self.sampler.last(self.sampler.depth)

    def keep_copied(self, chunk: Chunk, rows: NDArray[Any], times: LocalTimes) -> None:
        """Add copied records."""
        data, begin = rows.view(np.uint8).reshape(-1).data, 0
        for sequence, stamp in zip(rows["sequence"].tolist(), rows["stamp_ns"].tolist(), strict=True):
            chunk.add(self._channel, sequence, times.of(stamp), max(0, stamp), ENCAPSULATION,
                      data[begin : begin + self._size])
            begin += rows.itemsize

    def close(self) -> None:
        """Unmap."""
        self.sampler.close()


class MessageLog:
    """Status, warnings and errors of an instance as ROS messages (rcl_interfaces/msg/Log)."""

    def __init__(self, instance: str, table: ChannelTable) -> None:
        self._instance = instance
        self._channel = table.channel(f"{instance}/log", ros_name(Log), definition(Log), {names.INSTANCE: instance})

    def keep(self, chunk: Chunk, reader: RingReader, times: LocalTimes) -> None:
        """Add the event read last, if it is a message."""
        severity = int(reader.field("severity")[()])
        if severity not in LOG_LEVELS:
            return
        code, text, hint = (str(plain(reader.field(name).item())) for name in ("code", "text", "hint"))
        log_ns = times.of(reader.stamp_ns)
        message = log_line(log_ns, self._instance, severity, text, hint, code)
        chunk.add(self._channel, reader.sequence, log_ns, max(0, reader.stamp_ns), cdr.packed(message))


class RecordedView:
    """One view as a ROS message."""

    def __init__(self, system: str, entry: TopicEntry, table: ChannelTable, reader: RingReader) -> None:
        """Use the records that `reader` reads."""
        self.entry, self._reader = entry, reader
        row = VIEW_MESSAGES[entry.kind]
        self._channel = table.channel(entry.name, ros_name(row.message), definition(row.message),
                                      {names.INSTANCE: entry.instance, names.RING: entry.ring})
        self._view = PackedView(OpenTopic(system, entry, reader), frame_name(entry, reader))
        self._seen = -1

    def keep(self, chunk: Chunk, times: LocalTimes) -> None:
        """Add the view of the record last read, once per record."""
        reader = self._reader
        if reader.sequence == self._seen or not reader.stamp_ns:
            return
        self._seen = reader.sequence
        log_ns = times.of(reader.stamp_ns)
        self._view.pack(log_ns)
        chunk.add(self._channel, reader.sequence, log_ns, max(0, reader.stamp_ns), self._view.data)


def usual_views(entries: Sequence[TopicEntry]) -> list[TopicEntry]:
    """The views that are recorded by default."""
    return [entry for entry in entries if entry.kind in VIEW_MESSAGES and not entry.robot
            and entry.name.removeprefix(f"{entry.instance}/") in VIEWS]


class SystemSources:
    """All readable rings of a system, and the default views."""

    def __init__(self, system: str, table: ChannelTable, own: str) -> None:
        """`own`: instance of the recorder, which is recorded with the others."""
        self.system, self.table, self.own = system, table, own
        self.entries = [entry for entry in catalogue(system) if entry.kind != EVENT]
        self.problems: list[str] = []
        self.rings: dict[str, RecordedRing] = {}
        for entry in self.entries:
            if entry.kind != RECORD:
                continue
            try:
                self.rings[entry.name] = RecordedRing(system, entry.instance, entry.ring, table)
            except SegmentError as error:
                self.problems.append(str(error))
        self.views = [RecordedView(system, entry, table, self.rings[f"{entry.instance}/{entry.ring}"].sampler)
                      for entry in usual_views(self.entries) if f"{entry.instance}/{entry.ring}" in self.rings]

    def close(self) -> None:
        """Close all rings."""
        for ring in self.rings.values():
            ring.close()
