"""Files in the folder of a system's recordings."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

from trocar.procs.recordings import names


@dataclass(frozen=True, slots=True)
class KeptFile:
    """A file of the folder: its size, and the time of the last write (time of day, ns)."""

    path: Path
    size: int
    end_ns: int


def kept(folder: Path, kind: str) -> list[KeptFile]:
    """Recordings of a kind, in the order of their names, i.e. oldest first; unreadable files are left out."""
    found = []
    ours = re.compile(rf"{kind}-{names.TIME}(-.*)?\.mcap")
    for path in sorted(folder.glob(f"{kind}-*.mcap")):
        if not ours.fullmatch(path.name):  # a user's file
            continue
        try:
            status = path.stat()
        except OSError:
            continue
        found.append(KeptFile(path, status.st_size, status.st_mtime_ns))
    return found
