"""Headers that lie: fields of a segment's fixed header, changed behind everybody's back."""

from __future__ import annotations

from typing import Any

from trocar.shm.memory.segment import FIXED, path_of

FIELDS = ("magic", "version", "first", "fingerprint", "stride", "depth", "schema", "info", "kind", "size")


def rewrite(name: str, **changes: Any) -> None:
    """Change fields of the fixed header of a segment."""
    with path_of(name).open("r+b") as file:
        values = dict(zip(FIELDS, FIXED.unpack(file.read(FIXED.size)), strict=True))
        file.seek(0)
        file.write(FIXED.pack(*{**values, **changes}.values()))
