"""The recorder's files of a system: records from before the time that rings keep."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.gui.times import Times
from trocar.procs.recordings import names
from trocar.procs.recordings.folder import kept
from trocar.procs.recordings.reading import RecordingError, RecordingReader, Records, open_recording

Rows = dict[str, NDArray[Any]]
MAX_BYTES: Final = 64 << 20
"""Of records that one request reads."""


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

    def records(self, wanted: Callable[[str], bool], begin_ns: int, end_ns: int) -> Rows:
        """Records of wanted topics from `begin_ns` to `end_ns`, in order; both, and their stamps, are times of day."""
        found: dict[str, list[NDArray[Any]]] = {}
        left = MAX_BYTES
        for reader in self._readers(begin_ns, end_ns):
            chosen = [name for name in reader.record_topics if wanted(name) or name == names.CLOCK]
            read = []
            for name, piece in reader.pieces(chosen, begin_ns, end_ns + 1):
                left -= piece.rows.nbytes
                if left < 0:
                    raise ValueError(f"more than {MAX_BYTES >> 20} MB of records; choose a shorter time")
                read.append((name, piece))
            times = self._times([piece for name, piece in read if name == names.CLOCK])
            for name, piece in read:
                rows = piece.rows.copy()
                rows["stamp_ns"] = piece.local_ns if times is None else times.local(rows["stamp_ns"])
                found.setdefault(name, []).append(rows)
        return {name: _in_order(pieces) for name, pieces in found.items()}

    def _times(self, clocks: list[Records]) -> Times | None:
        """In simulated time, those of all records at full rate in a file are as if it passed as fast as real time."""
        if not self._is_simulated or not clocks:
            return None
        return Times(*(np.concatenate([piece.rows[name] for piece in clocks]) for name in ("system_ns", "local_ns")))

    def _readers(self, begin_ns: int, end_ns: int) -> Iterable[RecordingReader]:
        """Those that may have records of this time; a file that has grown is opened again."""
        files = [*kept(self._folder, names.BOX), *kept(self._folder, names.FAULT)]
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


def _in_order(pieces: list[NDArray[Any]]) -> NDArray[Any]:
    """Records of several files, which may have the same ones."""
    if any(piece.dtype != pieces[0].dtype for piece in pieces):
        pieces = [piece for piece in pieces if piece.dtype == pieces[-1].dtype]
    rows = np.concatenate(pieces)
    return rows[np.argsort(rows["stamp_ns"], kind="stable")]
