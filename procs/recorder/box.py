"""The black box: recordings of the last minutes in a few files, the oldest of which is removed for the next."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

from trocar.procs.recorder.disk import Disk, DiskFile
from trocar.procs.recorder.files import path_of, remove, too_old
from trocar.procs.recorder.sources import LocalTimes, SystemSources
from trocar.procs.recordings import names
from trocar.procs.recordings.chunks import Chunk
from trocar.procs.recordings.folder import KeptFile, kept
from trocar.shm.memory.segment import SegmentError

PARTS: Final = 10
"""Number of files over which the kept time, and the size, are divided."""
CHUNK_NS: Final = 1_000_000_000
CHUNK_BYTES: Final = 4 << 20
MOST: Final = 500
"""Maximum number of events of a ring that are read at once."""
VIEWS_NS: Final = 100_000_000


@dataclass(slots=True)
class BoxLimits:
    """Limits of the black box, and its sampling rate of records; may change at any time."""

    rate_hz: float
    minutes: float
    size_mb: float
    compression: str


class BlackBox:
    """The black-box files of this recorder process; `begin_file` opens one."""

    def __init__(self, folder: Path, disk: Disk, sources: SystemSources, times: LocalTimes, limits: BoxLimits,
                 begin_file: Callable[[Path, str], DiskFile]) -> None:
        self._folder, self._disk, self._sources, self._times = folder, disk, sources, times
        self.limits, self._begin_file = limits, begin_file
        self.chunk = Chunk()
        self.files: list[DiskFile] = []
        """Existing files of this process, oldest first; the last one is being written."""
        self._file_ns = self._chunk_ns = self._sample_ns = self._view_ns = 0
        self._begin_local_ns, self._begin_ns = times.local_ns, times.monotonic_ns
        self._ends: dict[Path, int] = {}
        self.dropped = self.written = 0
        self._complete = [ring for ring in sources.rings.values() if ring.is_complete]
        self._sampled = [ring for ring in sources.rings.values() if not ring.is_complete]

    def step(self) -> None:
        """Record what is due now."""
        times, now_ns, sources = self._times, self._times.monotonic_ns, self._sources
        for ring in self._complete:
            ring.drain(ring.sampler, self.chunk, times, MOST)
        if now_ns >= self._sample_ns:
            self._sample_ns = _next(self._sample_ns, now_ns, round(1e9 / self.limits.rate_hz))
            for ring in self._sampled:
                ring.sample(self.chunk, times)
            if now_ns >= self._view_ns:
                self._view_ns = _next(self._view_ns, now_ns, VIEWS_NS)
                for view in sources.views:
                    view.keep(self.chunk, times)
        if now_ns - self._chunk_ns >= CHUNK_NS or len(self.chunk.data) >= CHUNK_BYTES:
            self.flush()

    def flush(self) -> None:
        """Write collected records to the disk; end full files, and remove old ones."""
        now_ns, limits = self._times.monotonic_ns, self.limits
        self._chunk_ns = now_ns
        chunk, self.chunk = self.chunk, Chunk()
        part_s = 60.0 * limits.minutes / PARTS
        if self.files and (now_ns - self._file_ns >= part_s * 1e9
                           or self.files[-1].size >= limits.size_mb * 1e6 / PARTS):
            self._end()
            self._begin()
        elif not self.files:
            self._begin()
        self.files[-1].put(chunk, limits.compression)
        self.written += chunk.count

    def _begin(self) -> None:
        self._file_ns, local_ns = self._times.monotonic_ns, self._times.local_ns
        gone = too_old(self._kept(), self._steady_ns, 60.0 * self.limits.minutes,
                       round(self.limits.size_mb * 1e6 * (PARTS - 1) / PARTS))
        if gone:
            self._disk.do(remove(gone))
        self._forget({file.path for file in self.files if file.path in gone
                      or (file.is_ended and not file.path.exists())})
        self.files.append(self._begin_file(path_of(self._folder, names.BOX, local_ns), names.BOX))
        for ring in self._complete:
            if ring.is_seldom:  # the file with its last change may be gone
                with suppress(SegmentError):  # its name was removed, and no supervisor has it
                    ring.keep_newest(self.chunk, self._times)

    @property
    def _steady_ns(self) -> int:
        """Time of day without clock changes since our start, which must not change the age of files."""
        return self._begin_local_ns + self._times.monotonic_ns - self._begin_ns

    def _end(self) -> None:
        self.files[-1].finish({}, names.LOSSES)
        self._ends[self.files[-1].path] = self._steady_ns

    def _kept(self) -> list[KeptFile]:
        """The files on the disk, oldest first."""
        files = [replace(file, end_ns=self._ends.get(file.path, file.end_ns)) for file in kept(self._folder, names.BOX)]
        return sorted(files, key=lambda file: file.end_ns)

    def remove_oldest(self) -> bool:
        """Remove the oldest file, also from another thread; False if there is only the file being written."""
        present = self.files[-1].path if self.files else None
        for file in self._kept():
            if file.path != present:
                with suppress(OSError):
                    file.path.unlink()
                    return True
        return False

    def _forget(self, gone: set[Path]) -> None:
        """Forget files that were removed, by any program, or never written."""
        self.dropped += sum(file.dropped for file in self.files if file.path in gone)
        self.files = [file for file in self.files if file.path not in gone]
        self._ends = {file.path: self._ends[file.path] for file in self.files if file.path in self._ends}

    @property
    def all_dropped(self) -> int:
        """Number of messages dropped since start."""
        return self.dropped + sum(file.dropped for file in self.files)

    @property
    def size(self) -> int:
        """Size of the files of this process in bytes."""
        return sum(file.size for file in self.files)

    def close(self) -> None:
        """End the last file."""
        self.flush()
        self._end()


def _next(due_ns: int, now_ns: int, period_ns: int) -> int:
    """The next due time: one period later, or from now if a period was missed."""
    return due_ns + period_ns if now_ns - due_ns < period_ns else now_ns + period_ns
