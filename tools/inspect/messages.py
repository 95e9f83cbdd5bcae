"""Events and commands in lines for people, with the time of day, the same in every verb."""

from __future__ import annotations

import contextlib
from collections.abc import Mapping
from datetime import datetime
from typing import Any, Final

from trocar.shm.memory.holders import Holder
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.shm.system.events import SEVERITIES, STATUS
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import number, plain

AUDIT: Final = "audit"
MORE: Final = "…"
ALL: Final = 1 << 16  # records: more than any ring has
NO_ORIGIN: Final = "without an operator's command"


def time_of_day(local_ns: int) -> str:
    """Local time: 20:50:01.123; a dash if unknown."""
    return datetime.fromtimestamp(local_ns * 1e-9).time().isoformat("milliseconds") if local_ns > 0 else "–"


def severity(value: int) -> str:
    """A severity as a word; empty for an event that is not a message."""
    return SEVERITIES[value] if 0 <= value < len(SEVERITIES) else ""


def kind_of(row: Mapping[str, Any]) -> str:
    """Kind of event: status, warning with its code, error with its code, or the event's name."""
    word = severity(int(row["severity"]))
    return f"{word} {row['code']}".strip() if word else str(row["event"])


def text_of(row: Mapping[str, Any]) -> str:
    """Its text, with the hint."""
    if int(row["severity"]) >= STATUS:
        return f"{row['text']}; {row['hint']}" if row.get("hint") else str(row["text"])
    if row["state"]:
        flags = [word for word, on in (("homed", row["is_homed"]), ("busy", row["is_busy"])) if on]
        inner = "" if row["sub_state"] in (row["state"], "") else f" ({row['sub_state']})"
        who = f"{row['component']} " if row["component"] else ""
        return ", ".join([f"{who}{row['state']}{inner}", *flags])
    value = "" if row.get("value") is None else number(float(row["value"]), "g")  # a view of states has none
    return " ".join(part for part in (str(row["component"]), str(row.get("text", "")), value) if part)


def in_full(system: str, instance: str, text: str) -> str:
    """An answer or a reason that had too little room, and ends with "…": whole, as an event of its instance has it."""
    if not text.endswith(MORE):
        return text
    with contextlib.suppress(SegmentError):
        with contextlib.closing(directory.reader(system, instance, "events", often=False)) as reader:
            found = [text_of({name: plain(row[name]) for name in row.dtype.names}) for row in reader.last(ALL)]
        begin = text.removesuffix(MORE)
        for start in (begin, begin.partition(": ")[2]):  # "the arm went FAULT: " and the event's text
            if start:
                known = begin.removesuffix(start)
                whole = next((known + each[each.index(start):] for each in reversed(found) if start in each), "")
                if whole:
                    return whole
    return text


def line(row: Mapping[str, Any]) -> str:
    """One event on one line."""
    return f"{time_of_day(int(row['local_ns']))}  {kind_of(row)}  {text_of(row)}".rstrip()


def asked_rows(system: str, instance: str | None, most: int) -> tuple[list[dict[str, Any]], int]:
    """The newest `most` commands to all processes, or to one, oldest first, and the number of older ones.

    Problem: the process takes no commands, or the system is down.
    """
    rings, found, count = directory.rings(system), [], 0
    if not any(topic == AUDIT for _, topic in rings):
        raise Problem(f"{system} is down: commands are available while the system is up; recordings have them: "
                      "trocar recordings, trocar logs --commands --recording FILE")
    for name, topic in rings:
        if topic == AUDIT and instance in (None, name):
            with contextlib.closing(directory.reader(system, name, AUDIT, often=False)) as ring:
                kept = ring.last(ring.depth)
            count += len(kept)
            found += [{"process": name, **_asked_row(row)} for row in kept[len(kept) - min(most, len(kept)):]]
    if not found and instance is not None and (instance, AUDIT) not in rings:
        raise Problem(f"{instance}: there is no such process, or it takes no commands; trocar status lists them")
    found.sort(key=lambda row: row["monotonic_ns"])
    shown = found[len(found) - min(most, len(found)):]
    return shown, count - len(shown)


def _asked_row(row: Any) -> dict[str, Any]:
    found = {name: plain(row[name]) for name in row.dtype.names if name not in ("sequence", "count")}
    return found | ({"values": found["values"][: int(row["count"])]} if "values" in found else {})


def asked_line(row: dict[str, Any]) -> str:
    """One line: time, owner, command, outcome, origin."""
    values = (row.get("values") or ())[: row.get("count")]
    words = (row["command"], row["text"], *(number(value, ".6g") for value in values))
    asked = " ".join(filter(None, words))
    why = f" ({row['reason']})" if row["reason"] else ""
    whose = f"for {row['program'] or 'a program'}, number {row['origin']:x}, generation {row['generation']}"
    by = f" by {Holder(row['pid'], row.get('sender', '')).reported()}" if row["pid"] else ""
    return (f"{time_of_day(row['local_ns'])}  {row['process']}: {asked}: {row['outcome']}{why}; "
            f"{whose if row['origin'] else NO_ORIGIN}{by}")
