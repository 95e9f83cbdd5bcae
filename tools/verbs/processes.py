"""`trocar start|stop|restart NAME`: one process of a running system."""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from trocar.procs.document.process import ELSEWHERE, Process, processes_of
from trocar.procs.tables.manifest import proc
from trocar.shm.commands import became
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.tools.client.remote import Remote
from trocar.tools.inspect.watch import document_of
from trocar.tools.output.errors import Misuse, Problem, Refused
from trocar.tools.output.printing import answer, note, progress
from trocar.tools.systems.find import chosen_system, unknown
from trocar.tools.systems.processes import SUPERVISOR
from trocar.tools.verbs.options import JsonOption, SystemOption

PATIENCE_S = 80.0  # longer than the supervisor waits for a setup, and for the end of the one before


def _names(unfinished: str) -> list[str]:
    """For completion: the processes of the system that is up."""
    try:
        return [row.name for row in _rows(chosen_system()) if row.name.startswith(unfinished)]
    except (Problem, SegmentError, ValueError):
        return []


Name = Annotated[str, typer.Argument(metavar="NAME", help="A process, as status names it.", autocompletion=_names)]
Yes = Annotated[bool, typer.Option("--yes", "-y", help="Do it without asking.")]


def start(name: Name, as_json: JsonOption = False, system: SystemOption = None) -> int:
    """Start a process that was stopped, or was given up after repeated crashes; returns when it runs.

    It powers and moves nothing. A process that already runs is not affected.

    Example: trocar start PSM1
    """
    return _asked("start", name, as_json, chosen_system(system))


def stop(name: Name, yes: Yes = False, as_json: JsonOption = False, system: SystemOption = None) -> int:
    """Stop a process; it stays down until it is started. Names the processes that depend on it, and asks.

    Before an io stops, it switches its robots off properly. When an arm is stopped, io holds it where it is.

    Example: trocar stop PSM1 --yes
    """
    chosen = chosen_system(system)
    return _asked("stop", name, as_json, chosen) if _confirmed("stop", name, yes, system) else 1


def restart(name: Name, yes: Yes = False, as_json: JsonOption = False, system: SystemOption = None) -> int:
    """Restart a process; returns when it runs. Names the processes that depend on it, and asks.

    Example: trocar restart PSM1 --yes
    """
    chosen = chosen_system(system)
    return _asked("restart", name, as_json, chosen) if _confirmed("restart", name, yes, system) else 1


def _rows(system: str) -> list[Process]:
    """The processes that the supervisor starts."""
    return [row for row in processes_of(directory.document(system)) if row.start != ELSEWHERE]


def _row(system: str, name: str) -> Process:
    rows = {row.name: row for row in _rows(system)}
    user = None if name in rows else document_of(system).user(name)
    if user is not None and user.host:
        raise Problem(f"{name} is part of {user.host}, a process of several filters: trocar restart {user.host}")
    if name not in rows:
        raise unknown("process", name, rows)
    return rows[name]


def dependents(rows: list[Process], name: str) -> list[Process]:
    """What needs it, directly or not, in start order."""
    found, names = [], {name}
    for row in rows:
        if names & set(row.after):
            found.append(row)
            names.add(row.name)
    return found


def _confirmed(what: str, name: str, yes: bool, system: str | None) -> bool:
    """Whether to go on; asks where something depends on it, or a robot may. Misuse where nobody can be asked."""
    chosen = chosen_system(system)
    row, after = _row(chosen, name), dependents(_rows(chosen), name)
    if yes or not (after or proc(row.kind).realtime):
        return True
    lines = [f"When {name} ends, {proc(row.kind).on_exit}."]
    lines += [f"depends on it: {each.name} ({each.kind})" for each in after]
    if not sys.stdin.isatty():
        typed = f"trocar {what} {name}{f' --system {system}' if system else ''} --yes"
        raise Misuse("\n".join([*lines, f"nothing was done: there is no terminal to ask on; to do it: {typed}"]))
    note("\n".join(lines))
    if typer.confirm("Continue?", err=True):
        return True
    note("nothing was done")
    return False


def _asked(what: str, name: str, as_json: bool, system: str) -> int:
    _row(system, name)
    with Remote(system, SUPERVISOR) as remote, progress(f"{what} {name}") as say:
        say(f"{what} {name}", None)
        reply = remote.settled(what, text=name, timeout=PATIENCE_S)
    if reply.outcome != "done":
        raise Refused(reply.text or f"{what} {name} {became(reply.outcome)}")
    answer({"process": name, "outcome": reply.outcome, "text": reply.text}, reply.text, as_json)
    return 0
