"""Recordings of faults: the contents of all rings, and the black box before, in one file."""

from __future__ import annotations

import errno
from collections import deque
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Final

from numpy.typing import NDArray

from trocar.procs.recorder.disk import Disk, DiskFile
from trocar.procs.recorder.files import remove, too_many
from trocar.procs.recorder.sources import LocalTimes, RecordedRing, SystemSources
from trocar.procs.recorder.watch import SeenFault
from trocar.procs.recordings import names
from trocar.procs.recordings.chunks import Chunk
from trocar.procs.recordings.reading import chunks_of
from trocar.procs.recordings.writing import RecordingFile
from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingReader
from trocar.shm.time.clock import monotonic_ns

AFTER_NS: Final = 300_000_000
"""Delay after the first fault, so that its consequences are included; at most a third of what rings keep. If simulated
time is faster than real time, it counts: rings keep so much of the system's time.
"""
AWAITED: Final = frozenset({"io", "arm", "suj", "teleop"})
"""Kinds whose periodic rings limit the delay."""
QUIET_NS: Final = 2_000_000_000
"""Minimum interval of recordings: later faults wait together for the next one; rings still have their records."""
SLICE_NS: Final = 15_000_000
SLICE: Final = 200
CHUNK_BYTES: Final = 2 << 20


class FaultRecording:
    """One recording: call `step` until all rings are taken, then `finish`."""

    def __init__(self, first: SeenFault, sources: SystemSources, times: LocalTimes,
                 begin_file: Callable[[FaultRecording], DiskFile], since: tuple[int, int] | None = None) -> None:
        """`begin_file` explains the faults and opens the file. `since`: `times.now` at the fault; default: now."""
        self.faults = [first]
        self._sources, self._times, self._begin_file = sources, times, begin_file
        self._since = since or times.now
        self._after_ns = min([AFTER_NS, *(round(ring.depth_s * 1e9 / 3) for ring in sources.rings.values()
                                          if ring.kind in AWAITED and not ring.is_complete)])
        self._quiet_ns = times.monotonic_ns + QUIET_NS
        self.file: DiskFile | None = None
        self._chunk = Chunk()
        self.lost: dict[str, int] = {}
        """By topic, records that rings had when they were copied or read, but overwrote before their turn."""
        self._copied: deque[tuple[RecordedRing, NDArray[Any]]] = deque()
        self._complete: deque[tuple[RecordedRing, RingReader]] = deque()

    def add(self, fault: SeenFault) -> None:
        """Add another fault to this recording."""
        if fault not in self.faults:
            self.faults.append(fault)

    @property
    def reason(self) -> str:
        """All faults in words; errors first, as they have the reasons."""
        reasons = dict.fromkeys(each.reason for each in self.faults)
        return "; ".join(sorted(reasons, key=lambda text: text.endswith("in FAULT")))[:400]

    @property
    def code(self) -> str:
        """The code of the first error; empty if none is known."""
        return next((each.code for each in sorted(self.faults, key=lambda each: each.at_ns) if each.code), "")

    @property
    def is_first(self) -> bool:
        """Whether the system was well before."""
        return any(each.is_first for each in self.faults)

    @property
    def span_ns(self) -> tuple[int, int]:
        """Times of the first and last fault (monotonic); 0, 0 for a request without a fault."""
        found = [each.at_ns for each in self.faults if each.at_ns]
        return min(found, default=0), max(found, default=0)

    @property
    def takes_more(self) -> bool:
        """Whether further faults still belong to it, as no ring is taken yet."""
        return self.file is None

    @property
    def is_quiet(self) -> bool:
        """Whether the next recording may begin; the interval keeps a storm of faults from replacing all older files."""
        return self._times.monotonic_ns >= self._quiet_ns

    def step(self, compression: str, hurry: bool = False) -> bool:
        """Take records for SLICE_NS; True when all rings are taken. `hurry`: do not wait for later records."""
        if not hurry and self._times.passed_ns(self._since) < self._after_ns:
            return False
        if self.file is None:
            self._copy()
            self.file = self._begin_file(self)
        end_ns = monotonic_ns() + SLICE_NS
        while monotonic_ns() < end_ns:
            if len(self._chunk.data) >= CHUNK_BYTES and not self._flush(self.file, compression):
                return False
            if not self._take():
                return self._flush(self.file, compression)
        return False

    def _copy(self) -> None:
        """Copy periodic rings at once: however busy the machine is, none is overwritten while others are written.

        Those of io and of the instances in fault come first; what the others lose meanwhile is counted.
        """
        rings, instances = self._sources.rings.values(), {fault.instance for fault in self.faults}
        periodic = sorted((ring for ring in rings if not ring.is_complete),
                          key=lambda ring: ring.kind != "io" and ring.instance not in instances)
        heads = [ring.sampler.head for ring in periodic]
        for ring, head in zip(periodic, heads, strict=True):
            rows = ring.copy()
            oldest = int(rows["sequence"][0]) if len(rows) else head + 1
            self.lost[ring.topic] = max(0, oldest - max(1, head - ring.sampler.depth + 2))
            self._copied.append((ring, rows))
        for ring in [ring for ring in rings if ring.is_complete]:
            try:
                reader = ring.reader()
            except SegmentError:  # its name was removed, and no supervisor has it
                self.lost[ring.topic] = min(ring.sampler.head, ring.sampler.depth - 1)
                continue
            reader.rewind()
            self._complete.append((ring, reader))

    def _take(self) -> bool:
        """Take some records; False if there are none left."""
        if self._complete:
            ring, reader = self._complete[0]
            if ring.drain(reader, self._chunk, self._times, SLICE) < SLICE:
                self.lost[ring.topic] = reader.lost
                reader.close()
                self._complete.popleft()
        elif self._copied:
            ring, rows = self._copied.popleft()
            ring.keep_copied(self._chunk, rows[:SLICE], self._times)
            if len(rows) > SLICE:
                self._copied.appendleft((ring, rows[SLICE:]))
        else:
            return False
        return True

    def _flush(self, file: DiskFile, compression: str) -> bool:
        if not file.has_room(len(self._chunk.data)):
            return False
        file.put(self._chunk, compression)
        self._chunk = Chunk()
        return True

    def finish(self, folder: Path, disk: Disk, before: Sequence[Path], keep: int, since_ns: int = 0) -> None:
        """Append the black box, from `since_ns` (time of day) on, and end the file.

        Then remove files beyond `keep`, but never this one.
        """
        own = self.file
        if own is None:
            return
        for ring, rows in self._copied:
            self.lost[ring.topic] += len(rows)
        left = self._chunk.count + sum(len(rows) for _, rows in self._copied)
        if left or self._complete:  # the recorder ends before it has taken all
            own.dropped += left
            own.has_failed, own.problem = True, own.problem or "the recorder ended before it had taken all"

        def copy(file: RecordingFile) -> None:
            there = [path for path in before if path.exists()]
            for path in there:
                for chunk in chunks_of(path, since_ns):
                    file.put(chunk)
            if own.has_made_room and len(there) < len(before):
                raise OSError(errno.ENOSPC, "the oldest file of the black box was deleted to make room for it")

        own.do(copy)
        own.finish({topic: str(count) for topic, count in self.lost.items()}, names.LOSSES)
        disk.do(lambda: remove(too_many(folder, keep, own.path))())

    def close(self) -> None:
        """Close the open readers."""
        for _, reader in self._complete:
            reader.close()
