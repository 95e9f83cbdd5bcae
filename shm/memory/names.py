"""Names and locations of segments."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from trocar.shm.memory import private
from trocar.shm.memory.header import SegmentError

NAME: Final = re.compile(r"[A-Za-z0-9_-]{1,64}")
FOLDER: Final = Path("/dev/shm")


def segment_name(system: str, instance: str, what: str) -> str:
    """`/trocar~<system>~<instance>~<what>`; SegmentError if a part has characters that are not allowed."""
    for label, part in (("system", system), ("instance", instance), ("segment", what)):
        if not NAME.fullmatch(part):
            raise SegmentError(f"{label} name {part!r}: allowed are 1 to 64 letters, digits, _ and -")
    return f"/trocar~{system}~{instance}~{what}"


def path_of(name: str) -> Path:
    """The file of a segment, in /dev/shm or private."""
    return private.path(name) or FOLDER / name.removeprefix("/")
