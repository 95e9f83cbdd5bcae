"""The arrays of an arm's governor. n: joints, with the jaw."""

from __future__ import annotations

from typing import Final

from trocar.procs.native.fields import CStruct, rows

GOVERNOR: Final = CStruct("Governor", (
    *rows("i8", "", n="size"),
    *rows("f8", "n", goal="goal", target="target", asked="asked", velocity="velocity", feed="feed", rate="rate",
          speed="speed", acceleration="acceleration", lower="lower", upper="upper", behind="behind"),
    *rows("f8", "1", most="most"),
), {"advance": ("f8", "i8"), "measure": ()})
"""From `trocar.procs.arm.governor.Governor`."""
