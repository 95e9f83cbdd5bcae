"""The folder of a system's recordings: what its files are called, and which may stay."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from trocar.procs.recordings import names
from trocar.procs.recordings.reading import RecordingError, open_recording

NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,59}")


def path_of(folder: Path, kind: str, begin_ns: int, name: str = "") -> Path:
    """Where a recording is that begins now: box-TIME.mcap, fault-TIME-PSM1.mcap, NAME-TIME.mcap."""
    time = names.utc(begin_ns)
    words = [name, time] if kind == names.NAMED else [kind, time, *([name] if name else [])]
    return folder / f"{'-'.join(words)}.mcap"


@dataclass(frozen=True, slots=True)
class KeptFile:
    """A file of the folder: its size, and when it was last written to (time of day, ns)."""

    path: Path
    size: int
    end_ns: int


def kept(folder: Path, kind: str) -> list[KeptFile]:
    """Recordings of a kind, oldest first; what cannot be looked at is left out."""
    found = []
    ours = re.compile(rf"{kind}-{names.TIME}(-.*)?\.mcap")
    for path in sorted(folder.glob(f"{kind}-*.mcap")):
        if not ours.fullmatch(path.name):  # somebody's own
            continue
        try:
            status = path.stat()
        except OSError:
            continue
        found.append(KeptFile(path, status.st_size, status.st_mtime_ns))
    return found


def too_old(files: list[KeptFile], now_ns: int, seconds: float, most_bytes: int) -> list[Path]:
    """Those whose end is longer ago, and the oldest while all together are too large."""
    gone = [file for file in files if file.end_ns < now_ns - round(seconds * 1e9)]
    left = [file for file in files if file not in gone]
    while left and sum(file.size for file in left) > most_bytes:
        gone.append(left.pop(0))
    return [file.path for file in gone]


def too_many(folder: Path, most: int, newest: Path) -> list[Path]:
    """Recordings of faults that go where so many stay, `newest` among them.

    First those that came while something was not well yet: what it came of says the file before them.
    """
    files = [file.path for file in kept(folder, names.FAULT) if file.path != newest]
    firsts = [path for path in files if _is_first(path)]
    return [*(path for path in files if path not in firsts), *firsts][: max(0, len(files) + 1 - most)]


def _is_first(path: Path) -> bool:
    try:
        with open_recording(path) as recording:
            return bool(recording.metadata.get(names.SYSTEM, {}).get(names.FIRST))
    except RecordingError:
        return False


def remove(paths: list[Path]) -> Callable[[], None]:
    """A job for the disk: they are not kept any longer."""
    def job() -> None:
        for path in paths:
            path.unlink(missing_ok=True)

    return job
