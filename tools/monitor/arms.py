"""The page of arms: how each stands, why it is in FAULT or what it waits for, and what a person can do."""

from __future__ import annotations

from collections.abc import Sequence

from trocar.tools.inspect.messages import time_of_day
from trocar.tools.inspect.standing import Standing
from trocar.tools.output.printing import number


def cells(one: Standing) -> list[str]:
    """In the order of the page's columns."""
    fault = one.fault or {}
    homed = "–" if one.homed is None else "yes" if one.homed else "no"
    return [one.name, one.state, homed, str(fault.get("code") or ""), one.reason, str(fault.get("hint") or "")]


def details(one: Standing) -> list[str]:
    """The error that led to a FAULT as it was reported, and what to do."""
    lines = [f"{one.name} ({one.kind}): {one.state}"]
    if one.reason:
        lines.append(f"{'why' if one.is_fault else 'waiting'}: {one.reason.removeprefix('waiting: ')}")
    fault = one.fault
    if fault is not None:
        where = [f"axis {fault['axis']}" if int(fault["axis"]) >= 0 else "",
                 f"board {fault['board']}" if int(fault["board"]) >= 0 else ""]
        measured = "" if fault["value"] is None else f"measured {number(float(fault['value']), '.5g')}"
        allowed = "" if fault["limit"] is None else f"allowed {number(float(fault['limit']), '.5g')}"
        known = ", ".join(part for part in (str(fault["component"]), *where, measured, allowed) if part)
        lines.append(f"{fault['code']} at {time_of_day(int(fault['local_ns']))}: {known}")
        lines.append(f"reported: {fault['text']}")
        if fault["hint"]:
            lines.append(f"remedy: {fault['hint']}; then: trocar home {one.name}")
    return lines


def sought(found: Sequence[Standing], words: str) -> list[Standing]:
    """Those with these words."""
    return [one for one in found if words.casefold() in " ".join(cells(one)).casefold()]
