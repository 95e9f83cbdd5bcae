"""Systems that `trocar replay --as` shows: no process runs in them, and their clock is that of the recording."""

from __future__ import annotations

import contextlib
from typing import Any, Final

from trocar.shm.memory.segment import Segment, SegmentError, segment_name
from trocar.shm.time.system_time import SystemTime, speed_in_words
from trocar.tools.systems.find import is_up
from trocar.tools.systems.processes import SUPERVISOR

REPLAY: Final = "REPLAY"


def info_of_replay(clock: str) -> dict[str, Any]:
    """Header data of each control page in such a system."""
    return {"simulation": REPLAY, "clock": clock}


def is_replay(info: dict[str, Any]) -> bool:
    """Whether the header of a control page is of such a system: it has no process, so no mailbox and no table."""
    return info.get("simulation") == REPLAY


def recorded_clock(system: str) -> str:
    """The clock of the recording shown as `system`; empty: not a replay."""
    with contextlib.suppress(SegmentError), Segment(segment_name(system, SUPERVISOR, "control")) as page:
        return str(page.header.info.get("clock", "")) if is_replay(page.header.info) else ""
    return ""


def clock_in_words(system: str, time: SystemTime) -> str:
    """The clock of a system, and its speed while its supervisor lives."""
    recorded = recorded_clock(system)
    if recorded:
        return f"{recorded}, as recorded"
    return speed_in_words(time) if is_up(system) else time.clock
