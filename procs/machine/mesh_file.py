"""Files with meshes, as they are passed on to clients."""

from __future__ import annotations

import stat
from pathlib import Path
from typing import Final

MEDIA: Final = {".stl": "model/stl", ".dae": "model/vnd.collada+xml", ".obj": "model/obj"}
"""Formats of meshes."""
MAX_BYTES: Final = 20_000_000
"""Of a mesh; clients receive the whole file."""


def contents(file: Path) -> tuple[str, bytes]:
    """Media type and contents of a mesh; both empty if it cannot be read, is too large or has another format."""
    media, data = MEDIA.get(file.suffix.lower(), ""), b""
    try:
        found = file.lstat()  # links and pipes: it was a file when the system was started
        if media and stat.S_ISREG(found.st_mode) and found.st_size <= MAX_BYTES:
            data = file.read_bytes()
    except OSError:
        pass
    return (media, data) if data else ("", b"")
