"""The folder of a system's recordings: names of files, and which ones are kept."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Final

from trocar.procs.recordings import names
from trocar.procs.recordings.folder import KeptFile, kept
from trocar.procs.recordings.reading import RecordingError, open_recording

NAME: Final = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]{0,59}")


def path_of(folder: Path, kind: str, begin_ns: int, name: str = "") -> Path:
    """The path of a new recording: box-TIME.mcap, fault-TIME-PSM1.mcap, NAME-TIME.mcap."""
    time = names.utc(begin_ns)
    words = [name, time] if kind == names.NAMED else [kind, time, *([name] if name else [])]
    return folder / f"{'-'.join(words)}.mcap"


def too_old(files: list[KeptFile], now_ns: int, seconds: float, most_bytes: int) -> list[Path]:
    """Files that ended more than `seconds` ago, and the oldest ones until the total size fits `most_bytes`."""
    gone = [file for file in files if file.end_ns < now_ns - round(seconds * 1e9)]
    left = [file for file in files if file not in gone]
    while left and sum(file.size for file in left) > most_bytes:
        gone.append(left.pop(0))
    return [file.path for file in gone]


def too_many(folder: Path, most: int, newest: Path) -> list[Path]:
    """Recordings of faults to remove if `most` are kept, `newest` among them.

    Consequential faults go first, i.e. those while the system was not yet well: their cause is in an earlier file.
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
    """A job for the disk that removes these files."""
    def job() -> None:
        for path in paths:
            path.unlink(missing_ok=True)

    return job
