"""How arms, teleoperations and consoles stand, why they are in FAULT or what they wait for, and what to do first."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from procs.codes import SHARED_BOARD
from shm import directory
from shm.ring import RingReader
from shm.segment import SegmentError
from tools.inspect.processes import DEAD, FAILED, SILENT, STALLED, ProcessStatus
from tools.printing import plain
from tools.running import SUPERVISOR

FAULT = "FAULT"
FAULT_KEYS = ("code", "component", "axis", "board", "value", "limit", "text", "hint", "monotonic_ns", "local_ns")
COLUMNS = ("name", "state", "homed", "why, or what it waits for")


@dataclass(frozen=True, slots=True)
class Standing:
    """One of them. `reason`: in FAULT why, else what it waits for; `fault`: the error that led there, as data.

    `homed` is None for what is not homed. `person`: only a person can bring about what it waits for.
    """

    name: str
    kind: str
    state: str
    homed: bool | None = None
    reason: str = ""
    person: bool = False
    fault: dict[str, Any] | None = None

    @property
    def is_fault(self) -> bool:
        """It is in FAULT."""
        return self.state.startswith(FAULT)


def standings(system: str, processes: Sequence[ProcessStatus]) -> list[Standing]:
    """All of a system, in the order of its processes."""
    readers = {"arm": _arm, "suj": _arm, "third_party": _third_party, "teleop": _teleop, "console": _console}
    found = []
    for process in processes:
        read = readers.get(process.kind)
        if read is not None:
            with contextlib.suppress(SegmentError):
                reader = directory.reader(system, process.name, "state", process.kind, often=False)
                try:
                    one = read(system, process, reader) if reader.newest() else Standing(process.name, process.kind,
                                                                                         "–")
                finally:
                    reader.close()
                found.append(one)
    return found


def _text(reader: RingReader, field: str) -> str:
    return str(plain(reader.field(field).item()))


def _flag(reader: RingReader, field: str) -> bool:
    return bool(reader.field(field)[()])


def _arm(system: str, process: ProcessStatus, reader: RingReader) -> Standing:
    state, inner, reason = _text(reader, "state"), _text(reader, "sub_state"), _text(reader, "reason")
    shown = state if inner == state else f"{state} {inner}"
    fault = _last_error(system, process) if state == FAULT else None
    return Standing(process.name, process.kind, shown, _flag(reader, "is_homed"), reason, "trocar send" in reason,
                    fault)


def _third_party(system: str, process: ProcessStatus, reader: RingReader) -> Standing:
    return Standing(process.name, process.kind, _text(reader, "state"), _flag(reader, "is_homed"))


def _teleop(system: str, process: ProcessStatus, reader: RingReader) -> Standing:
    state = _text(reader, "state") + (", following" if _flag(reader, "following") else "")
    reason, fault = _text(reader, "reason"), _last_error(system, process)
    if reason and fault and str(fault["text"]).endswith(reason):
        reason += f"; {fault['hint']}"
    return Standing(process.name, process.kind, state, None, reason)


def _console(system: str, process: ProcessStatus, reader: RingReader) -> Standing:
    enabled, present = _flag(reader, "teleop_enabled"), _flag(reader, "operator_present")
    pressed = [word for word in ("clutch", "camera") if _flag(reader, word)]
    state = ", ".join(["teleoperation on" if enabled else "teleoperation off", *pressed])
    if not _flag(reader, "valid"):
        reason = "one of its inputs is silent: the operator counts as absent"
    elif not enabled:
        reason = f"a person: trocar send {process.name} teleop_enable 1"
    else:
        reason = "" if present else "the operator: pedal or head sensor"
    return Standing(process.name, process.kind, state, None, reason)


def _last_error(system: str, process: ProcessStatus) -> dict[str, Any] | None:
    """The newest error of an instance, as data."""
    reader = directory.reader(system, process.name, "events", process.kind, often=False)
    try:
        rows = reader.last(1 << 16)
        errors = rows[rows["event"] == b"error"]
        return {key: plain(errors[-1][key]) for key in FAULT_KEYS} if len(errors) else None
    finally:
        reader.close()


def first_thing(processes: Sequence[ProcessStatus], found: Sequence[Standing]) -> str:
    """What a person does first, in a line; empty: all is well."""
    for process in processes:
        if process.problem:
            more = f" ({process.exit_reason})" if process.exit_reason else ""
            return f"{process.name} is {process.problem}{more}: {_help(process)}"
    faults = sorted((one for one in found if one.is_fault), key=_cause_first)
    if faults:
        one = faults[0]
        hint = f"; {one.fault['hint']}" if one.fault and one.fault["hint"] else ""
        names = " ".join(each.name for each in faults)
        what = one.reason if one.name in one.reason else f"{one.name}: {one.reason or 'FAULT'}"
        return f"{what}{hint}. Then: trocar home {names}"
    waiting = next((one for one in found if one.person), None)
    return f"{waiting.name} waits: {waiting.reason}" if waiting is not None else ""


def _help(process: ProcessStatus) -> str:
    """What a person types for a process that has a problem."""
    name, problem = process.name, process.problem
    is_dead = problem == DEAD or problem.startswith(FAILED)
    if process.kind == SUPERVISOR:
        return f"{'' if is_dead else 'trocar down; then '}trocar up FILE starts the system again"
    if problem in (SILENT, DEAD) and not process.lifecycle:
        return "it is a third-party program; start it again"
    if is_dead:
        return f"trocar start {name}; trocar logs {name} may say why"
    return f"trocar restart {name}" if problem == STALLED else f"trocar logs {name}"


def _cause_first(one: Standing) -> tuple[bool, int]:
    """The fault that came first is the cause of others, but for one that says itself that it follows from another."""
    fault = one.fault or {}
    return fault.get("code") == SHARED_BOARD.code, int(fault.get("monotonic_ns") or 0)


def next_step(found: Sequence[Standing]) -> str:
    """What may come next where all is well; empty: nothing in particular."""
    arms = [one for one in found if one.kind in ("arm", "suj")]
    off = [one for one in arms if one.state.startswith("DISABLED")]
    if off and len(off) == len(arms):
        return "trocar home"
    return ""


def cells(one: Standing) -> tuple[str, ...]:
    """A row of a table with COLUMNS."""
    homed = "–" if one.homed is None else "yes" if one.homed else "no"
    return one.name, one.state, homed, one.reason
