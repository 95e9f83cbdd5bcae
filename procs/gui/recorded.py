"""The recorder's files of a system: records from before the time that rings keep."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.gui.times import Times
from trocar.procs.recordings import names
from trocar.procs.recordings.folder import kept
from trocar.procs.recordings.picked import picked
from trocar.procs.recordings.reading import RecordingError, RecordingReader, Records, open_recording

Rows = dict[str, NDArray[Any] | str]
MAX_BYTES: Final = 64 << 20
"""Of records of one topic in an answer."""
MAX_ALL: Final = 256 << 20
"""The same of all topics."""


@dataclass(frozen=True, slots=True)
class FaultFile:
    """The recording of a fault: its time (time of day), instance and reason."""

    name: str
    at_ns: int
    instance: str
    reason: str
    size: int


class RecordedFiles:
    """The black box, and the recordings of faults. Files of another configuration are left out: joints, limits and
    names may have another meaning there.
    """

    def __init__(self, folder: Path, document: bytes, *, is_simulated: bool) -> None:
        self._folder, self._document, self._is_simulated = folder, document, is_simulated
        self._open: dict[Path, tuple[int, RecordingReader | None]] = {}
        self._faults: dict[Path, FaultFile] = {}

    def faults(self) -> list[FaultFile]:
        """Completed recordings of faults, oldest first."""
        files = kept(self._folder, names.FAULT)
        self._faults = {path: fault for path, fault in self._faults.items() if path in {file.path for file in files}}
        for file in files:
            known = self._faults.get(file.path)
            if known is not None and known.size == file.size:
                continue
            try:
                with open_recording(file.path) as reader:
                    said = reader.metadata.get(names.SYSTEM, {})
                    if reader.is_whole and reader.document == self._document:
                        self._faults[file.path] = FaultFile(file.path.name, names.time_in(file.path.name),
                                                            said.get("name", ""), said.get("reason", ""), file.size)
            except RecordingError:
                continue
        return [self._faults[file.path] for file in files if file.path in self._faults]

    def records(self, topics: Mapping[str, np.dtype[np.void]], begin_ns: int, end_ns: int, check: Callable[[], None],
                *, only_last: bool = False) -> Rows:
        """Records of topics from `begin_ns` to `end_ns`, in order, or the last one of each; both, and their stamps, are
        times of day. Instead of records there is a text if they are too many. `check`: see `picked`.
        """
        found = {name: _Wanted(begin_ns, end_ns, only_last, self._is_simulated) for name in topics}
        left = MAX_ALL
        for reader in self._readers(begin_ns, end_ns):
            choose = {name: row.choose for name, row in found.items()
                      if name in reader.topics and reader.topics[name].dtype == topics[name]}
            times = self._times(reader, begin_ns, end_ns, check)
            for name, piece in picked(reader, choose, begin_ns, end_ns, check):
                left -= found[name].add(piece, times)
                if left < 0:
                    raise ValueError(f"more than {MAX_ALL >> 20} MB of records; choose a shorter time")
            for row in found.values():
                row.ended(reader.path.name.startswith(names.FAULT))
        return {name: row.problem or row.rows() for name, row in found.items() if row.is_found}

    def _times(self, reader: RecordingReader, begin_ns: int, end_ns: int, check: Callable[[], None]) -> Times | None:
        """In simulated time, those of all records at full rate in a file are as if it passed as fast as real time."""
        if not self._is_simulated:
            return None
        clock = _Wanted(begin_ns, end_ns, only_last=False, is_simulated=True)
        clocks = [piece.rows for _, piece in picked(reader, {names.CLOCK: clock.choose}, begin_ns, end_ns, check)]
        if not clocks:
            return None
        return Times(*(np.concatenate([rows[name] for rows in clocks]) for name in ("system_ns", "local_ns")))

    def _readers(self, begin_ns: int, end_ns: int) -> Iterable[RecordingReader]:
        """Those that may have records of this time, faults first; a file that has grown is opened again."""
        files = [*kept(self._folder, names.FAULT), *kept(self._folder, names.BOX)]
        for path in self._open.keys() - {file.path for file in files}:
            self._close(path)
        for file in files:
            is_fault = file.path.name.startswith(names.FAULT)  # it has the minutes before that
            if file.end_ns < begin_ns or (not is_fault and names.time_in(file.path.name) > end_ns):
                continue
            if self._open.get(file.path, (-1, None))[0] != file.size:
                self._close(file.path)
                self._open[file.path] = file.size, self._opened(file.path)
            reader = self._open[file.path][1]
            if reader is not None and reader.begin_ns <= end_ns and reader.end_ns >= begin_ns:
                yield reader

    def _opened(self, path: Path) -> RecordingReader | None:
        """None: not a recording of this configuration."""
        try:
            reader = open_recording(path)
        except RecordingError:
            return None
        if reader.document == self._document:
            return reader
        reader.close()
        return None

    def _close(self, path: Path) -> None:
        reader = self._open.pop(path, (0, None))[1]
        if reader is not None:
            reader.close()

    def close(self) -> None:
        """Close all files."""
        for path in list(self._open):
            self._close(path)


class _Wanted:
    """Those records of a topic that are wanted: all of a time, or the last one; those of several files only once."""

    def __init__(self, begin_ns: int, end_ns: int, only_last: bool, is_simulated: bool) -> None:
        self._begin_ns, self._end_ns, self._only_last, self._is_simulated = begin_ns, end_ns, only_last, is_simulated
        self._rows: list[NDArray[Any]] = []
        self._local: list[NDArray[np.int64]] = []
        self._size, self.problem = 0, ""
        self._last_ns = begin_ns - 1
        self._covered: list[tuple[int, int]] = []
        self._here: list[int] = []

    @property
    def is_found(self) -> bool:
        """Whether there are any, or too many."""
        return bool(self.problem or self._rows)

    def choose(self, times: NDArray[np.int64]) -> NDArray[np.intp]:
        """See Choose."""
        chosen = (times > self._last_ns) & (times <= self._end_ns) & (not self.problem)
        for begin_ns, end_ns in self._covered:
            chosen &= (times < begin_ns) | (times > end_ns)
        places = np.flatnonzero(chosen)
        if self._only_last and not self._is_simulated and len(places):
            return places[[np.argmax(times[places])]]
        return places

    def add(self, piece: Records, times: Times | None) -> int:
        """Take chosen records; returns the bytes by which those kept have become more."""
        rows, logged = piece.rows, piece.local_ns
        local = logged if times is None else times.local(rows["stamp_ns"])
        before = self._size
        if self._only_last:
            known = np.flatnonzero(local <= self._end_ns)
            if len(known):
                last = known[[np.argmax(local[known])]]
                self._rows, self._local, self._size = [rows[last]], [local[last]], rows.itemsize
                self._last_ns = int(logged[last[0]])
            return self._size - before
        self._here += [int(logged.min()), int(logged.max())]
        self._rows.append(rows)
        self._local.append(local)
        self._size += rows.nbytes
        if self._size > MAX_BYTES:
            self._rows, self._local, self._size = [], [], 0
            self.problem = f"more than {MAX_BYTES >> 20} MB of records; choose a shorter time"
        return self._size - before

    def ended(self, is_fault: bool) -> None:
        """The end of a file. That of a fault has a copy of the black box: no other file has more of the same time."""
        if is_fault and self._here:
            self._covered.append((min(self._here), max(self._here)))
        self._here = []

    def rows(self) -> NDArray[Any]:
        """All of them in the order of their times of day; a file may have one twice."""
        rows, local = np.concatenate(self._rows), np.concatenate(self._local)
        order = np.lexsort((rows["sequence"], rows["stamp_ns"]))
        is_new = np.ones(len(order), bool)
        is_new[1:] = (np.diff(rows["stamp_ns"][order]) != 0) | (np.diff(rows["sequence"][order]) != 0)
        chosen = order[is_new]
        chosen = chosen[np.argsort(local[chosen], kind="stable")]
        found = rows[chosen]
        found["stamp_ns"] = local[chosen]
        return found
