"""Recorded records as a readable system: in shared memory, for viewing only, without commands.

Its rings have the recorded layout and info, `simulation` is REPLAY. Stamps are present CLOCK_MONOTONIC times with the
recorded spacing, so that tools find them fresh; numbers count from 1. There are no mailboxes.
"""

from __future__ import annotations

import contextlib
import dataclasses
import heapq
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.system import WALL, from_json, to_json
from trocar.procs.recordings import names
from trocar.procs.recordings.reading import RecordedTopic, RecordingReader
from trocar.shm.memory.closable import Closable
from trocar.shm.memory.layout import MAX_DEPTH, Schema, schema_from_json
from trocar.shm.memory.parts import remove_all
from trocar.shm.memory.segment import Segment, create, names_of, segment_name
from trocar.shm.ring.ring import RingWriter
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.control_page import ControlPage, create_control
from trocar.shm.topics import TOPICS, Topic
from trocar.tools.analysis.choosing import Stretch, run_begin_ns
from trocar.tools.inspect.replayed import REPLAY, info_of_replay
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import Say
from trocar.tools.systems.cleanup import Keeper
from trocar.tools.systems.processes import SUPERVISOR

DEPTH_S: Final = 3.0
SMALLEST: Final = 64
BEAT_S: Final = 0.02
LATE_NS: Final = 100_000_000


@dataclass(slots=True)
class ReplayedTopic:
    """One ring being written: its records, and the progress."""

    name: str
    rows: NDArray[Any]
    writer: RingWriter
    rate_hz: float
    at: int = 0
    last_ns: int = 0

    @property
    def stamp_ns(self) -> int:
        """Of the next record."""
        return int(self.rows["stamp_ns"][self.at])


class Showing(Closable):
    """The system shown; a context manager that removes everything at any end."""

    def __init__(self, system: str, recording: RecordingReader, topics: Sequence[str], part: Stretch) -> None:
        """Make it; Problem if there is one of that name, or no data to show."""
        if names_of(system) or names_of(system, foreign=True):
            raise Problem(f"system {system} is there already; --as gives another name")
        self.system, self.topics, self._pages = system, list[ReplayedTopic](), list[ControlPage]()
        self._held = contextlib.ExitStack()
        try:
            self._held.enter_context(Keeper(system))
            self._held.callback(remove_all, self.system)
            self._make(recording, topics, part)
        except BaseException:
            self._held.close()
            raise

    def _make(self, recording: RecordingReader, topics: Sequence[str], part: Stretch) -> None:
        rows = [recording.topics[name] for name in topics]
        directory.publish_document(self.system, _document(recording, self.system))
        marks = info_of_replay(recording.metadata.get(names.SYSTEM, {}).get("clock") or WALL)

        def marked(name: str, kind: str, schema: Schema, depth: int, info: dict[str, Any]) -> int:
            return create(name, kind, schema, depth, info | marks)

        for instance in dict.fromkeys((SUPERVISOR, *(row.instance for row in rows))):
            create_control(self.system, instance, marked, [topic for row in rows if row.instance == instance
                                                           for topic in _declared(row)])
            page = ControlPage(self.system, instance, write=True)
            self._held.callback(page.close)
            page.segment.claim(instance)
            page.field("pid")[...] = os.getpid()
            page.show("RUNNING")
            self._pages.append(page)
        for row in rows:
            records = recording.records(row.name, stamps=part.stamps).rows
            create(segment_name(self.system, row.instance, row.ring), directory.RING,
                   schema_from_json(row.schema.encode()), _depth(row), row.info | {"simulation": REPLAY})
            segment = Segment(segment_name(self.system, row.instance, row.ring), write=True)
            writer = RingWriter(segment, row.instance)
            self._held.callback(writer.close)
            self.topics.append(ReplayedTopic(row.name, records, writer, row.rate_hz))
        if not any(len(topic.rows) for topic in self.topics):
            raise Problem("there is nothing to show: no records of these topics in this time")

    @property
    def begin_ns(self) -> int:
        """Stamp at which the run itself begins: older records are shown at once."""
        extents = {topic.name: (topic.stamp_ns, int(topic.rows["stamp_ns"][-1])) for topic in self.topics
                   if len(topic.rows)}
        return run_begin_ns(extents, {topic.name: topic.rate_hz for topic in self.topics})

    @property
    def end_ns(self) -> int:
        """Stamp of the last record."""
        return max(int(topic.rows["stamp_ns"][-1]) for topic in self.topics if len(topic.rows))

    def play(self, speed: float, say: Say) -> int:
        """Show all records at `speed`, with the times between them; returns how many. Ctrl-C ends it."""
        begin_ns, whole_ns, shown = self.begin_ns, max(1, self.end_ns - self.begin_ns), 0
        start_ns, beat_ns = monotonic_ns(), 0
        for topic in self._in_order():
            passed_ns = max(0, round((topic.stamp_ns - begin_ns) / speed))
            while (left_ns := start_ns + passed_ns - (now_ns := monotonic_ns())) > 0 or now_ns - beat_ns > BEAT_S * 1e9:
                if now_ns - beat_ns > BEAT_S * 1e9:
                    self._beat(now_ns)
                    say(f"{passed_ns * 1e-9:.1f} s", passed_ns * speed / whole_ns)
                    beat_ns = now_ns
                pause(min(max(left_ns, 0) * 1e-9, BEAT_S))
            row = topic.rows[topic.at : topic.at + 1]
            topic.writer.copy(row.view(np.uint8).data)
            topic.last_ns = max(start_ns + passed_ns, topic.last_ns + 1)
            topic.writer.publish(topic.last_ns)
            shown += 1
        return shown

    def _in_order(self) -> Iterator[ReplayedTopic]:
        """The topic of the next record, repeatedly."""
        heap = [(topic.stamp_ns, k) for k, topic in enumerate(self.topics) if len(topic.rows)]
        heapq.heapify(heap)
        while heap:
            _, k = heap[0]
            topic = self.topics[k]
            yield topic
            topic.at += 1
            if topic.at < len(topic.rows):
                heapq.heapreplace(heap, (topic.stamp_ns, k))
            else:
                heapq.heappop(heap)

    def _beat(self, now_ns: int) -> None:
        for page in self._pages:
            page.field("heartbeat_ns")[...] = now_ns

    def close(self) -> None:
        """Take it away."""
        self._held.close()


def _declared(row: RecordedTopic) -> list[Topic]:
    """Its row of the table, if it has one: fields that would be computed on demand."""
    return [topic for topic in TOPICS if topic.name == row.ring and topic.writer in (row.kind, "*")]


def _depth(row: RecordedTopic) -> int:
    return int(min(max(SMALLEST, row.rate_hz * DEPTH_S, 0 if row.rate_hz else 1024), MAX_DEPTH))


def _document(recording: RecordingReader, system: str) -> bytes:
    """The recorded configuration under our name, on the wall clock; an empty one where it cannot be read."""
    with contextlib.suppress(ValueError):
        return to_json(dataclasses.replace(from_json(recording.document), name=system, clock=WALL))
    return b"{}"
