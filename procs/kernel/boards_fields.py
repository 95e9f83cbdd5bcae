"""The arrays of the emulated boards' stages."""

from __future__ import annotations

from typing import Final

from procs.kernel.fields import CStruct, rows

ENCODERS: Final = CStruct("Encoders", (  # procs.boards.controllers.encoder.Encoders; n: axes of all boards
    *rows("i8", "", n="slots", boards="boards", width="width", columns="columns", first="first", states="states"),
    *rows("f8", "3 n", curve="curve"),
    *rows("f8", "n", was="was"),
    *rows("b1", "n", turned="turned", hidden="hidden"),
    *rows("i8", "6 n", queue="queue"),
    *rows("i8", "n", state="state", offset="offset", overflow="overflow", lag="lag"),
    *rows("i8", "states", state_table="state_table"),
    *rows("i8", "7 states", flag_table="flag_table"),
    *rows("u4", "boards", pins="pins"),
    *rows("u4", "boards columns", rows="rows"),
), {"set_out": ("i8", "i8"), "advance": ("f8",), "show": ("i8",)})

BOARDS: Final = (ENCODERS,)
