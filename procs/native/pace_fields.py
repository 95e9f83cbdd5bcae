"""The data from which a loop's next cycle is computed, from `trocar.procs.node.pacing.Pacing`."""

from __future__ import annotations

from typing import Final

from trocar.procs.native.fields import CStruct, rows

# Indices in a loop's words; all times in ns.
DEADLINE: Final = 0
"""Of this cycle, then of the next one."""
START: Final = 1
"""When this cycle began."""
WANTED: Final = 2
"""A time that deadlines are pulled to at the end of this cycle, 0: none."""
STEP: Final = 3
"""Or to any time that is a multiple of this step away."""
CYCLES: Final = 4
MISSED: Final = 5
"""Deadlines."""
OVERRUNS: Final = 6
KEPT: Final = 7
"""Number of cycles in the statistics of this second."""
LOOK: Final = 8
"""When there is more to do."""
WORDS: Final = 9

PACE: Final = CStruct("Pace", (
    *rows("i8", "", period_ns="period_ns", quickest_ns="quickest_ns", room="room"),
    *rows("f8", "", gain="gain"),
    *rows("i8", str(WORDS), words="words"),
    # for the cycles of this second
    *rows("f8", "room", periods="periods", work="work"),
    # in the control page
    *rows("i8", "1", beat="beat"),
    *rows("u8", "1", cycles="cycles", missed="missed", overruns="overruns"),
    *rows("u4", "1", wakeup="wakeup"),
), {"end_of_work": ("i8", "i8"), "begin_work": ("i8",), "wait": ("i8", "i8"), "sleep": ("i8",)},
   frozenset({"wait", "sleep"}))
