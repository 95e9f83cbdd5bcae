"""State of arms, teleoperations and consoles, reasons for FAULT or pending conditions, and the first step to take."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from numpy.typing import NDArray

from trocar.procs.document.process import remarks_of
from trocar.procs.machine.verb_lines import REMEDY
from trocar.procs.tables.codes import IO_TIMEOUT, MEMORY_REMOVED, SHARED_BOARD
from trocar.procs.tables.lifecycle import DONE, is_meant, may_have_written
from trocar.procs.tables.operator_waits import OF_THE_OPERATOR
from trocar.shm.memory.segment import SegmentError
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.tools.inspect.messages import in_full
from trocar.tools.inspect.processes import (
    DEAD,
    DETACHED,
    FAILED,
    NOT_ATTACHED,
    NOT_RUNNING,
    PAGE_GONE,
    SILENT,
    STALLED,
    STOPPED,
    ProcessStatus,
)
from trocar.tools.output.printing import plain, span
from trocar.tools.systems.processes import SUPERVISOR, commissioning

FAULT, ON, OFF, FOLLOWING = "FAULT", "teleoperation on", "teleoperation off", ", following"
ARMS = ("arm", "suj")
FAULT_KEYS = ("code", "component", "axis", "board", "value", "limit", "text", "hint", "stamp_ns", "monotonic_ns",
              "local_ns")
CAUSED_NS, SEEN_LATER_NS = 3_000_000_000, 500_000_000
NEVER = "–"  # nothing published yet
COLUMNS = ("name", "state", "homed", "why, or what it waits for")


def system_remarks(system: str) -> tuple[bool, str]:
    """Whether the system is in calibration mode, and why its rings keep less than usual; neither if it is unknown."""
    with contextlib.suppress(SegmentError, ValueError):
        return remarks_of(directory.document(system))
    return False, ""


@dataclass(frozen=True, slots=True)
class Standing:
    """One of them. `reason`: cause of a FAULT, else the pending condition; `fault`: the error behind it, as data.

    `homed` is None for kinds without homing. `person`: only a person can meet the condition.
    """

    name: str
    kind: str
    state: str
    homed: bool | None = None
    reason: str = ""
    person: bool = False
    silent: bool = False
    """It waits for a silent process."""
    fault: dict[str, Any] | None = None
    since_ns: int = 0
    """In FAULT: since when (monotonic); 0: no longer known."""
    holds_up: bool = False
    """A teleoperation that does not follow for a reason that is neither silence nor its operator."""
    at_wall: bool = False
    """The reason is a wall that keeps an arm from its goal: no problem, and nothing to wait for."""
    age_s: float | None = None
    """Its process is gone: age of this state, s."""

    @property
    def is_between(self) -> bool:
        """Whether it is not homed, and changes to another state: POWERING, HOMING."""
        return self.homed is False and " " in self.state

    @property
    def is_fault(self) -> bool:
        """Whether it is in FAULT."""
        return self.state.startswith(FAULT)


def standings(system: str, processes: Sequence[ProcessStatus]) -> list[Standing]:
    """All of a system, in the order of its processes."""
    readers = {"arm": _arm, "suj": _setup_joints, "third_party": _third_party, "teleop": _teleop, "console": _console}
    found = []
    for process in processes:
        read = readers.get(process.kind)
        if read is not None:
            with contextlib.suppress(SegmentError):
                with contextlib.closing(
                        directory.reader(system, process.name, "state", process.kind, often=False)) as reader:
                    one = read(system, process, reader) if reader.newest() else Standing(
                        process.name, process.kind, NEVER, reason=_untaken(process))
                one = _with_what_is_left(one, process, processes)
                is_old = one.state != NEVER and (process.problem == SILENT or not process.lives)
                found.append(dataclasses.replace(one, age_s=process.silent_s or 0.0) if is_old else one)
    return found


def _with_what_is_left(one: Standing, process: ProcessStatus, processes: Sequence[ProcessStatus]) -> Standing:
    """For an arm whose io was silent, or whose emulated boards ended: the cause and the remaining steps."""
    if one.fault is None:
        return one
    ios = [row for row in processes if row.kind == "io" and row.name in process.after]
    causes = ios if one.fault["code"] == IO_TIMEOUT.code else [
        row for row in processes if row.kind == "boards" and _ended_before(row, int(one.fault["stamp_ns"]))]
    if not causes:
        return one
    away = [row.name for row in causes if row.state != "RUNNING" or row.problem]
    first = f"wait until {away[0]} is back, or trocar start {away[0]}; then " if away else ""
    why = [f"{row.name} ended: {row.exit_reason}; " for row in causes if not is_meant(row.exit_reason or DONE)]
    return dataclasses.replace(one, fault={**one.fault, "hint": f"{''.join(why)}{first}trocar home {one.name}"})


def _ended_before(process: ProcessStatus, fault_ns: int) -> bool:
    """Whether it ended so shortly before a fault that this is the cause; the supervisor sees an end a beat later."""
    return any(-SEEN_LATER_NS <= fault_ns - past.stamp_ns <= CAUSED_NS for past in process.endings)


def _untaken(process: ProcessStatus) -> str:
    return "start the program for this arm" if process.state == NOT_ATTACHED else ""


def _text(reader: RingReader, field: str) -> str:
    return str(plain(reader.field(field).item()))


def _flag(reader: RingReader, field: str) -> bool:
    return bool(reader.field(field)[()])


def _arm(system: str, process: ProcessStatus, reader: RingReader) -> Standing:
    state, inner = _text(reader, "state"), _text(reader, "sub_state")
    reason = in_full(system, process.name, _text(reader, "reason"))
    shown = state if inner == state else f"{state} {inner}"
    events = _events(system, process) if state == FAULT else None
    wall = "" if reason else _at_wall(system, process)
    return Standing(process.name, process.kind, shown, _flag(reader, "is_homed"), reason or wall,
                    "trocar send" in reason, fault=_last_error(events), since_ns=_fault_ns(events), at_wall=bool(wall))


def _at_wall(system: str, process: ProcessStatus) -> str:
    """The wall that keeps an arm from its goal, and how far it is: at wall table: 0.1 mm; "": none."""
    with contextlib.suppress(SegmentError), contextlib.closing(
            directory.reader(system, process.name, "walls", process.kind, often=False)) as reader:
        if process.kind == "arm" and reader.newest() and (at := _text(reader, "stopped_by")):
            names = [plain(name) for name in reader.field("name").tolist()]
            wall = at.partition(":")[0].partition(" (")[0]
            far = float(reader.field("distance")[names.index(wall)]) if wall in names else math.nan
            return f"at wall {at}" + (f", {far * 1e3:.1f} mm" if math.isfinite(far) else "")
    return ""


def _setup_joints(system: str, process: ProcessStatus, reader: RingReader) -> Standing:
    """Homed setup joints with unknown positions name these joints."""
    one = _arm(system, process, reader)
    names = reader.info.get("setups") or ()  # a recording may have none
    unknown = [name for name, valid in zip(names, reader.field("setup_valid"), strict=False) if not valid]
    if not one.homed or one.reason or not unknown:
        return one
    return dataclasses.replace(
        one,
        reason=f"the joints of {', '.join(unknown)} are unknown: not all read yet, moving, or potentiometers disagree")


def _third_party(system: str, process: ProcessStatus, reader: RingReader) -> Standing:
    state = _text(reader, "state")
    reason = f"start its program again: {_text(reader, 'program')}" if process.state == DETACHED else ""
    return Standing(process.name, process.kind, state, _flag(reader, "is_homed"), reason,
                    since_ns=_fault_ns(_events(system, process)) if state == FAULT else 0)


def _teleop(system: str, process: ProcessStatus, reader: RingReader) -> Standing:
    follows = _flag(reader, "following")
    state = _text(reader, "state") + (FOLLOWING if follows else "")
    reason = in_full(system, process.name, _text(reader, "reason"))
    fault = _last_error(_events(system, process))
    if reason and fault and str(fault["text"]).endswith(reason):
        reason += f"; {fault['hint']}"
    silent = reason.endswith((" is silent", " are silent"))
    holds_up = bool(reason) and not (follows or silent or any(words in reason for words in OF_THE_OPERATOR))
    return Standing(process.name, process.kind, state, None, reason, silent=silent, holds_up=holds_up)


def _console(system: str, process: ProcessStatus, reader: RingReader) -> Standing:
    enabled, present = _flag(reader, "teleop_enabled"), _flag(reader, "operator_present")
    pressed = [word for word in ("clutch", "camera") if _flag(reader, word)]
    state = ", ".join([ON if enabled else OFF, *pressed])
    silent = not _flag(reader, "valid")
    if silent:
        reason = "one of its inputs is silent: the operator counts as absent"
    elif not enabled:
        reason = f"an operator's command: {_enable(process.name)}"
    else:
        reason = "" if present else "the operator: pedal or head sensor"
    return Standing(process.name, process.kind, state, None, reason, silent=silent)


def _enable(console: str) -> str:
    return f"trocar send {console} teleop_enable 1"


def _events(system: str, process: ProcessStatus) -> NDArray[Any]:
    """All events of an instance that there still are."""
    with contextlib.closing(directory.reader(system, process.name, "events", process.kind, often=False)) as reader:
        return reader.last(reader.depth)


def _last_error(events: NDArray[Any] | None) -> dict[str, Any] | None:
    """The newest error, as data."""
    if events is None:
        return None
    errors = events[events["event"] == b"error"]
    return {key: plain(errors[-1][key]) for key in FAULT_KEYS} if len(errors) else None


def _fault_ns(events: NDArray[Any] | None) -> int:
    """Time of its last change to FAULT; its refusals of commands report FAULT again."""
    states = events[events["event"] == b"operating_state"] if events is not None else ()
    since_ns = 0
    for row in reversed(states):
        if row["state"] != FAULT.encode():
            break
        since_ns = int(row["monotonic_ns"])
    return since_ns


def first_thing(processes: Sequence[ProcessStatus], found: Sequence[Standing]) -> str:
    """The first step for a person, in a line; empty: all is well."""
    return next(filter(None, (step(processes, found) for step in STEPS)), "")


Step = Callable[[Sequence[ProcessStatus], Sequence[Standing]], str]
"""One kind of problem of a system, with its remedy; empty: it has none of this kind."""


def _of_a_driver(processes: Sequence[ProcessStatus], _: Sequence[Standing]) -> str:
    """A process without which arms cannot move has ended or hangs."""
    return next((_with_help(one) for one in processes if one.problem and one.moves_the_robot and not one.works), "")


def _fault(_: Sequence[ProcessStatus], found: Sequence[Standing]) -> str:
    faults = sorted((one for one in found if one.is_fault), key=_cause_first)
    if not faults:
        return ""
    one = faults[0]
    hint = f"; {one.fault['hint']}" if one.fault and one.fault["hint"] else ""
    others = " ".join(each.name for each in faults if f"trocar home {each.name}" not in hint)
    what = f"{one.name}: {one.reason}" if one.reason else f"{one.name} is in FAULT"
    what = one.reason if one.name in one.reason else what
    return f"{what}{hint}{f'. Then: trocar home {others}' if others else ''}"


def _of_a_process(processes: Sequence[ProcessStatus], _: Sequence[Standing]) -> str:
    """Any other problem of a process; those of processes that move the robot come first."""
    unwell = sorted((one for one in processes if one.problem), key=lambda one: not one.moves_the_robot)
    return _with_help(unwell[0]) if unwell else ""


def _restarted(processes: Sequence[ProcessStatus], _: Sequence[Standing]) -> str:
    again = next((one for one in processes if one.restarted_s is not None or one.begins_again), None)
    if again is None:
        return ""
    since = "is not up yet" if again.begins else f"was restarted {span(again.restarted_s or 0.0)} ago"
    return f"{again.name} {since}: {again.exit_reason}{_logs(again, again.exit_reason)}"


def _waiting(_: Sequence[ProcessStatus], found: Sequence[Standing]) -> str:
    """Something waits for a person."""
    return next((f"{one.name} waits: {one.reason}" for one in found if one.person), "")


def _on_its_way(_: Sequence[ProcessStatus], found: Sequence[Standing]) -> str:
    """An arm changes its state, or waits for a condition."""
    return next((f"wait for {one.name}: {', '.join(filter(None, (one.state, one.reason)))}" for one in found
                 if one.kind in ARMS and ((one.reason and not one.at_wall) or one.is_between)), "")


def _not_following(_: Sequence[ProcessStatus], found: Sequence[Standing]) -> str:
    """A teleoperation does not follow although its console has switched it on."""
    is_on = any(one.kind == "console" and one.state.startswith(ON) and not one.reason for one in found)
    return next((f"{one.name}: {one.reason}" for one in found if one.holds_up), "") if is_on else ""


def _silent(processes: Sequence[ProcessStatus], found: Sequence[Standing]) -> str:
    """Something waits for a silent process, although all are up."""
    silent = next((one for one in found if one.silent), None)
    if silent is None or any(one.begins for one in processes):
        return ""
    missing = [f"; {one.name}: {one.reason}" for one in found if one.kind == "third_party" and one.reason
               and f"{one.name} is silent" in silent.reason]
    return f"{silent.name}: {silent.reason}{''.join(missing)}"


def _beginning(processes: Sequence[ProcessStatus], _: Sequence[Standing]) -> str:
    begins = [one.name for one in processes if one.begins]
    return f"{', '.join(begins)} {'is' if len(begins) == 1 else 'are'} not up yet; wait for it" if begins else ""


STEPS: Final[tuple[Step, ...]] = (_of_a_driver, _fault, _of_a_process, _restarted, _waiting, _on_its_way,
                                  _not_following, _silent, _beginning)
"""The most urgent first."""


def in_a_line(processes: Sequence[ProcessStatus], found: Sequence[Standing]) -> str:
    """The last line of `status`: all well with a possible next step, or the first step."""
    first, then = first_thing(processes, found), guide_of(processes) or next_step(found)
    return f"first: {first}" if first else f"all well; next: {then}" if then else "all well"


def guide_of(processes: Sequence[ProcessStatus]) -> str:
    """Instructions of `trocar commission` while it runs the system; empty: it does not."""
    pid = next((commissioning(process.pid) for process in processes if process.kind == SUPERVISOR), 0)
    return f"as trocar commission (pid {pid}) says, and nothing else meanwhile" if pid else ""


def _with_help(process: ProcessStatus) -> str:
    """Its problem and the command to type; a process that names the command itself needs no other."""
    is_its_own = not process.word and REMEDY in process.problem
    return process.said if is_its_own else f"{process.said}: {_help(process)}"


def _logs(process: ProcessStatus, told: str) -> str:
    """The log that may say why it ended, unless it is `told` or cannot."""
    log = f"trocar logs {process.name}"
    return "" if log in told or not may_have_written(process.exit_reason) else f"; {log} may say why"


def _help(process: ProcessStatus) -> str:
    """The command to type for a process with a problem."""
    name, problem = process.typed, process.problem
    is_dead, logs = process.word in (DEAD, FAILED), f"trocar logs {process.name}"
    why = _logs(process, problem)
    if process.kind == SUPERVISOR and process.works:
        return MEMORY_REMOVED.remedy
    if process.kind == SUPERVISOR or problem == PAGE_GONE:
        return f"{'' if is_dead else 'trocar down; then '}trocar up FILE starts the system again"
    if process.host:
        return f"trocar restart {name}{why}" if is_dead else logs
    if problem in (SILENT, DEAD) and not process.lifecycle:
        end = f"end it (kill {process.pid}), then " if problem == SILENT else ""
        return f"it is a third-party program; {end}start it again"
    if problem == STOPPED:
        return f"trocar start {name}"
    if is_dead and process.lifecycle == "RUNNING":
        return "wait until the supervisor sees its end"
    if is_dead or process.word == NOT_RUNNING:
        first = " once its cause is removed" if process.word == FAILED else ""
        return f"trocar start {name}{first}{why}"
    return f"trocar restart {name}" if problem == STALLED else logs


def _cause_first(one: Standing) -> tuple[bool, int]:
    """The first fault is the cause of others, unless it reports itself as a consequence of another."""
    fault = one.fault or {}
    return fault.get("code") == SHARED_BOARD.code, int(fault.get("monotonic_ns") or 0)


def next_step(found: Sequence[Standing]) -> str:
    """A possible next step if all is well; empty: none in particular."""
    arms = [one for one in found if one.kind in ARMS]
    paused = [one.name for one in arms if one.state.startswith("PAUSED")]
    powered = [one.name for one in arms if one.state == "ENABLED" and one.homed is False]
    if {one.state for one in arms} == {"DISABLED"}:  # with a sub-state it is on its way
        return "trocar home"
    if paused:
        return f"trocar send {paused[0]} state_command resume"
    if powered:
        return f"trocar home {' '.join(powered)}"
    return _next_of_homed(arms, found)


def _next_of_homed(arms: Sequence[Standing], found: Sequence[Standing]) -> str:
    if not all(one.homed for one in arms):
        return ""
    off = next((one.name for one in found if one.kind == "console" and one.state.startswith(OFF)), "")
    return _enable(off) if off else next((f"{one.name}: {one.reason}" for one in found if one.kind == "teleop"
                                          and one.reason and not one.state.endswith(FOLLOWING)), "")


def cells(one: Standing) -> tuple[str, ...]:
    """A row of a table with COLUMNS; past states show their age, and count as not homed."""
    if one.age_s is not None:
        return one.name, f"{one.state}, {span(one.age_s)} ago", "–", one.reason
    homed = "–" if one.homed is None else "yes" if one.homed else "no"
    return one.name, one.state, homed, one.reason
