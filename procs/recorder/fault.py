"""Recordings of faults: the contents of all rings, and the black box before, in one file."""

from __future__ import annotations

import errno
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

from trocar.procs.recorder.disk import Disk, DiskFile
from trocar.procs.recorder.files import remove, too_many
from trocar.procs.recorder.sources import LocalTimes, RecordedRing, SystemSources
from trocar.procs.recorder.watch import SeenFault
from trocar.procs.recordings import names
from trocar.procs.recordings.chunks import Chunk
from trocar.procs.recordings.reading import chunks_of
from trocar.procs.recordings.writing import RecordingFile
from trocar.shm.ring.ring import RingReader
from trocar.shm.time.clock import monotonic_ns

AFTER_NS: Final = 300_000_000
"""Delay after the first fault, so that its consequences are included."""
QUIET_NS: Final = 2_000_000_000
"""Minimum interval of recordings: later faults wait together for the next one; rings still have their records."""
SLICE_NS: Final = 15_000_000
SLICE: Final = 200
CHUNK_BYTES: Final = 2 << 20


class FaultRecording:
    """One recording: call `step` until all rings are taken, then `finish`."""

    def __init__(self, first: SeenFault, sources: SystemSources, times: LocalTimes,
                 begin_file: Callable[[FaultRecording], DiskFile], since_ns: int = 0) -> None:
        """`begin_file` explains the faults and opens the file. `since_ns`: time of the fault (monotonic); 0: now."""
        self.faults = [first]
        self._sources, self._times, self._begin_file = sources, times, begin_file
        self._after_ns = (since_ns or times.monotonic_ns) + AFTER_NS
        self._quiet_ns = times.monotonic_ns + QUIET_NS
        self.file: DiskFile | None = None
        self._chunk, self.lost = Chunk(), 0
        self._left: list[RecordedRing] | None = None
        self._ring: tuple[RecordedRing, RingReader] | None = None

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
        if not hurry and self._times.monotonic_ns < self._after_ns:
            return False
        if self._left is None or self.file is None:
            rings = [ring for ring in self._sources.rings.values() if not ring.is_complete]
            first = {fault.instance for fault in self.faults}
            self._left = sorted(rings, key=lambda ring: (ring.depth_s, ring.instance not in first), reverse=True)
            self._left = [*(ring for ring in self._sources.rings.values() if ring.is_complete), *self._left]
            self.file = self._begin_file(self)
        end_ns = monotonic_ns() + SLICE_NS
        while monotonic_ns() < end_ns:
            if self._ring is None and not self._next_ring(self._left):
                return self._flush(self.file, compression)
            if not self._take(self.file, compression):
                break
        return False

    def _next_ring(self, left: list[RecordedRing]) -> bool:
        if not left:
            return False
        ring = left.pop()
        reader = ring.reader()
        reader.rewind()
        self._ring = ring, reader
        return True

    def _take(self, file: DiskFile, compression: str) -> bool:
        """Take some records of the present ring; False if the disk's queue has no room now."""
        if self._ring is None:
            return True
        ring, reader = self._ring
        if len(self._chunk.data) >= CHUNK_BYTES and not self._flush(file, compression):
            return False
        if ring.drain(reader, self._chunk, self._times, SLICE) < SLICE:
            self.lost += reader.lost
            reader.close()
            self._ring = None
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

        def copy(file: RecordingFile) -> None:
            there = [path for path in before if path.exists()]
            for path in there:
                for chunk in chunks_of(path, since_ns):
                    file.put(chunk)
            if own.has_made_room and len(there) < len(before):
                raise OSError(errno.ENOSPC, "the oldest file of the black box was deleted to make room for it")

        own.do(copy)
        own.finish({"rings": str(self.lost)}, names.LOSSES)
        disk.do(lambda: remove(too_many(folder, keep, own.path))())

    def close(self) -> None:
        """Close the open reader, if any."""
        if self._ring is not None:
            self._ring[1].close()
