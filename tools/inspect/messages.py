"""Events as people read them: one line each, with the time of day, the same in every verb."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from datetime import datetime
from typing import Any, Final

from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.shm.system.events import SEVERITIES, STATUS
from trocar.tools.output.printing import number, plain

MORE: Final = "…"
ALL: Final = 1 << 16  # records: more than any ring has


def time_of_day(local_ns: int) -> str:
    """Local time: 20:50:01.123; a dash when there is none."""
    return datetime.fromtimestamp(local_ns * 1e-9).time().isoformat("milliseconds") if local_ns > 0 else "–"


def severity(value: int) -> str:
    """A severity as a word; empty for what is no message."""
    return SEVERITIES[value] if 0 <= value < len(SEVERITIES) else ""


def kind_of(row: Mapping[str, Any]) -> str:
    """What sort of event: status, warning with its code, error with its code, or the event's name."""
    word = severity(int(row["severity"]))
    return f"{word} {row['code']}".strip() if word else str(row["event"])


def text_of(row: Mapping[str, Any]) -> str:
    """What it says, with the hint."""
    if int(row["severity"]) >= STATUS:
        return f"{row['text']}; {row['hint']}" if row.get("hint") else str(row["text"])
    if row["state"]:
        flags = [word for word, on in (("homed", row["is_homed"]), ("busy", row["is_busy"])) if on]
        inner = "" if row["sub_state"] in (row["state"], "") else f" ({row['sub_state']})"
        who = f"{row['component']} " if row["component"] else ""
        return ", ".join([f"{who}{row['state']}{inner}", *flags])
    value = "" if row["value"] is None else number(float(row["value"]), "g")
    return " ".join(part for part in (str(row["component"]), str(row["text"]), value) if part)


def in_full(system: str, instance: str, text: str) -> str:
    """An answer or a reason that had too little room, and ends with "…": whole, as an event of its instance has it."""
    if not text.endswith(MORE):
        return text
    with contextlib.suppress(SegmentError):
        with contextlib.closing(directory.reader(system, instance, "events", often=False)) as reader:
            found = [text_of({name: plain(row[name]) for name in row.dtype.names}) for row in reader.last(ALL)]
        begin = text.removesuffix(MORE)
        for start in (begin, begin.partition(": ")[2]):  # "the arm went FAULT: " and what the event says
            if start:
                known = begin.removesuffix(start)
                whole = next((known + each[each.index(start):] for each in reversed(found) if start in each), "")
                if whole:
                    return whole
    return text


def line(row: Mapping[str, Any]) -> str:
    """One event on one line."""
    return f"{time_of_day(int(row['local_ns']))}  {kind_of(row)}  {text_of(row)}".rstrip()
