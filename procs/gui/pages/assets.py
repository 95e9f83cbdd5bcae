"""Style and scripts of the pages, under an address that changes when one of them does."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path
from typing import Final

from trocar.procs.gui.pages.element import Part

STATIC: Final = Path(__file__).resolve().parent.parent / "static"
MEDIA: Final = {".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}


@cache
def asset_files() -> dict[str, bytes]:
    """Contents of all files that pages use, by their names below `assets()`."""
    return {str(path.relative_to(STATIC)): path.read_bytes() for path in sorted(STATIC.rglob("*"))
            if path.suffix in MEDIA}


@cache
def assets() -> str:
    """Address of the files: a checksum of their names and contents."""
    sums = "".join(f"{name} {hashlib.sha256(text).hexdigest()}\n" for name, text in asset_files().items())
    return f"/assets/{hashlib.sha256(sums.encode()).hexdigest()[:16]}"


def script(name: str) -> None:
    """Use a module on this page; it runs when the whole page is there."""
    Part("script", type="module", src=f"{assets()}/{name}")
