"""Style and scripts of the pages, under an address that changes when one of them does."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Final

from nicegui import ui

STATIC: Final = Path(__file__).resolve().parent.parent / "static"


@cache
def assets() -> str:
    """Address of the files."""
    newest = max(path.stat().st_mtime_ns for path in STATIC.iterdir())
    return f"/assets/{newest:x}"


def style(name: str) -> None:
    """Use a style sheet on this page."""
    ui.add_head_html(f'<link rel="stylesheet" href="{assets()}/{name}">')


def script(name: str) -> None:
    """Use a module on this page."""
    ui.add_head_html(f'<script type="module" src="{assets()}/{name}"></script>')
