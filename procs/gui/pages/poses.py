"""Rows of a table of x, y and z: positions in mm, orientations in degrees, the same on all pages."""

from __future__ import annotations

from typing import Any, Final

from trocar.procs.gui.pages.element import Part
from trocar.procs.gui.pages.parts import live

TURNS: Final = "turned about x, then y, then z: fixed axes"


def axes() -> None:
    """The head of the table, which is a `box("numbers")`."""
    for text in ("", "x", "y", "z"):
        Part("b", "quiet", text)


def numbers(text: str, path: str, form: str, first: int = 0, **attributes: Any) -> None:
    """A row with three numbers of a field."""
    Part("span", "", text)
    for i in range(first, first + 3):
        live(f"{path}.{i}", form, **attributes)


def turned(pose: str, **attributes: Any) -> None:
    """A row with the orientation of a pose in degrees."""
    Part("span", "", "turned about, °", title=TURNS)
    for i in range(3):
        live(pose, f"turn:{i}", **attributes)
