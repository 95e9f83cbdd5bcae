"""Recordings on request: every record of chosen topics."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from trocar.procs.crtk.demand import Wanted
from trocar.procs.crtk.topics import TopicEntry
from trocar.procs.recorder.disk import DiskFile
from trocar.procs.recorder.sources import LocalTimes, RecordedRing, RecordedView, SystemSources, usual_views
from trocar.procs.recordings import names
from trocar.procs.recordings.chunks import Chunk
from trocar.procs.ros_messages.view_messages import VIEW_MESSAGES
from trocar.shm.ring.ring import RingReader

CHUNK_NS: Final = 500_000_000
CHUNK_BYTES: Final = 2 << 20
MOST: Final = 1500
"""Maximum number of records of a ring read in a period: one second at 1500 Hz."""
SLOW_NS: Final = 10_000_000_000
VIEWS_HZ: Final = 50.0
BY_DEFAULT: Final = ("arm", "suj", "io", "third_party", "teleop", "console")
"""Kinds whose topics are recorded by default."""


def chosen(sources: SystemSources, topics: Sequence[str]) -> list[TopicEntry]:
    """The topics of these names; PSM1 alone means all rings of PSM1. ValueError names one that does not exist."""
    if not topics:
        kinds = {name: str(ring.sampler.info.get("kind", "")) for name, ring in sources.rings.items()}
        return [entry for entry in sources.entries if kinds.get(entry.name) in BY_DEFAULT]
    found: list[TopicEntry] = []
    for topic in topics:
        ours = [entry for entry in sources.entries if entry.name == topic
                or (entry.instance == topic and entry.name in sources.rings)]
        if not ours:
            raise ValueError(f"no topic {topic}; trocar list names them all; events are always included")
        found += [entry for entry in ours if entry not in found]
    return found


@dataclass(slots=True)
class Drained:
    """A ring recorded completely, with its own reader and its views."""

    source: RecordedRing
    reader: RingReader
    views: list[RecordedView]
    every: int = 1
    """Views record one of this many records."""


class NamedRecording:
    """One recording on request, from its beginning on."""

    def __init__(self, name: str, sources: SystemSources, entries: Sequence[TopicEntry], file: DiskFile,
                 times: LocalTimes, seconds: float, compression: str) -> None:
        """`seconds`: duration, 0: until stopped. From now on, all groups of the topics are requested on demand."""
        self.name, self.file, self._times, self._compression = name, file, times, compression
        self.seconds, self._begin_system_ns, self._since_ns = seconds, times.system_ns, times.local_ns
        self._chunk, self._chunk_ns, self._end_ns, self._end_system_ns = Chunk(), times.monotonic_ns, 0, 0
        self._demand = Wanted(sources.system, names.NAMED, every=True)
        self._rings: dict[str, Drained] = {}
        self._log = [Drained(ring, ring.reader(), []) for ring in sources.rings.values() if ring.is_complete
                     and ring.topic != f"{sources.own}/state"]
        for each in self._log:
            if each.source.is_seldom:
                each.reader.rewind(1)
        whole = {f"{entry.instance}/{entry.ring}" for entry in entries}
        whole.add(f"{sources.own}/state")  # it has the time by all clocks
        try:
            for topic in sorted(whole & sources.rings.keys()):
                source = sources.rings[topic]
                if source.is_complete and source.topic != f"{sources.own}/state":
                    continue
                reader = source.reader(often=True)
                self._rings[topic] = self._drained(sources, source, reader, entries)
            for entry in entries:
                self._demand.take(entry)
        except BaseException:
            self.close()
            raise

    def _drained(self, sources: SystemSources, source: RecordedRing, reader: RingReader,
                 entries: Sequence[TopicEntry]) -> Drained:
        """The chosen views, for each record; without any, the default views, for some records."""
        here = [entry for entry in sources.entries if f"{entry.instance}/{entry.ring}" == source.topic]
        views = [entry for entry in here if entry in entries and entry.kind in VIEW_MESSAGES]
        every = 1 if views else max(1, round(source.rate_hz / VIEWS_HZ))
        return Drained(source, reader, [RecordedView(sources.system, entry, sources.table, reader)
                                        for entry in views or usual_views(here)], every)

    @property
    def passed_s(self) -> float:
        """Its duration so far, s of the system's time."""
        return ((self._end_system_ns or self._times.system_ns) - self._begin_system_ns) * 1e-9

    @property
    def lost(self) -> int:
        """Number of chosen records that are missing: overwritten before they were read, or dropped at the disk."""
        return sum(each.reader.lost for each in (*self._rings.values(), *self._log)) + self.file.dropped

    @property
    def is_ending(self) -> bool:
        """Whether it takes no more records."""
        return self._end_ns > 0

    @property
    def is_written(self) -> bool:
        """Whether all of it is on the disk, or the disk is too slow to wait for."""
        return self.file.is_ended or self._times.monotonic_ns > self._end_ns + SLOW_NS

    @property
    def is_over(self) -> bool:
        """Whether its duration has passed."""
        return bool(self.seconds) and self.passed_s >= self.seconds

    @property
    def topics(self) -> list[str]:
        """Rings that are recorded completely."""
        return list(self._rings)

    def step(self) -> None:
        """Record all new records."""
        times = self._times
        for each in (*self._log, *self._rings.values()):
            if each.views:
                self._drain_with_views(each)
            else:
                each.source.drain(each.reader, self._chunk, times, MOST, self._since_ns)
            if len(self._chunk.data) >= CHUNK_BYTES:
                self._flush()
        if times.monotonic_ns - self._chunk_ns >= CHUNK_NS:
            self._flush()

    def _drain_with_views(self, each: Drained) -> None:
        for _ in range(MOST):
            if not each.reader.next():
                return
            each.source.keep(self._chunk, each.reader, self._times)
            if each.reader.sequence % each.every == 0:
                for view in each.views:
                    view.keep(self._chunk, self._times)

    def _flush(self) -> None:
        self._chunk_ns = self._times.monotonic_ns
        chunk, self._chunk = self._chunk, Chunk()
        self.file.put(chunk, self._compression)

    def losses(self) -> dict[str, str]:
        """Number of lost records by topic."""
        return {topic: str(each.reader.lost) for topic, each in self._rings.items()}

    def end(self) -> None:
        """Take the last records, and end the file."""
        self.step()
        self._end_ns, self._end_system_ns = self._times.monotonic_ns, self._times.system_ns
        self._flush()
        self.file.finish(self.losses(), names.LOSSES)
        self.close()

    def close(self) -> None:
        """Drop all demand, and close the readers."""
        self._demand.close()
        for each in (*self._rings.values(), *self._log):
            each.reader.close()


