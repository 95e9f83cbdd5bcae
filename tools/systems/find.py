"""Running systems, the selected one, and the remains of crashed ones."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from trocar.procs.crtk.names import none_such
from trocar.procs.machine.paths import ROOT, given_file, log_folder, not_found
from trocar.procs.tables.codes import MEMORY_REMOVED
from trocar.shm.memory import owners, private
from trocar.shm.memory.owners import SERVICE_USER
from trocar.shm.memory.parts import held_names, parts_of, removed_words
from trocar.shm.memory.process_start import lives
from trocar.shm.memory.segment import (
    Identity,
    Segment,
    SegmentError,
    held,
    names_of,
    owner_of,
    path_of,
    segment_name,
)
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.control_page import ControlPage
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import note
from trocar.tools.systems.processes import SUPERVISOR, RunningProcess, running

STALLED_NS = 1_000_000_000  # the supervisor beats every 20 ms
LOOK_AGAIN_S = 0.1
LAST = 3  # systems that are named where none is up
OF_FOREIGN = f"{SERVICE_USER} names another user whose memory is accepted"


def environment() -> dict[str, str]:
    """Our environment, with the project found from any working folder (to which relative paths refer)."""
    rest = os.environ.get("PYTHONPATH", "")
    return {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{rest}" if rest else str(ROOT)}


def system_file(file: Path, path: Sequence[Path] = ()) -> Path:
    """A system file by name, also along `--path` and in configs/; Problem if there is none."""
    found = given_file(file, path)
    if not found.exists():
        raise Problem(f"{file}: {not_found(file, path)}")
    return found


def alive(identity: Identity) -> bool:
    """Whether the process that last claimed a segment is still alive. Reads /proc only: takes no lock."""
    return lives(identity.pid, identity.start)


def supervisor_of(system: str) -> Identity | None:
    """The supervisor of a system: by its control page, or if that fails, by the kernel's process list."""
    return _as_its_page_says(system) or _as_listed(running(system)).get(system)


def _as_its_page_says(system: str) -> Identity | None:
    with contextlib.suppress(SegmentError), Segment(segment_name(system, SUPERVISOR, "control")) as segment:
        identity = segment.identity()
        if alive(identity) and segment.claimed():
            return identity
    return None


def _as_listed(processes: Iterable[RunningProcess]) -> dict[str, Identity]:
    """The supervisors among processes, by their systems."""
    found = [process for process in processes if process.instance == SUPERVISOR]
    return {process.system: Identity(process.pid, 0, process.start, SUPERVISOR) for process in reversed(found)}


def is_up(system: str) -> bool:
    """Whether a living supervisor holds the system."""
    return supervisor_of(system) is not None


def orphaned(system: str) -> str:
    """Why no part of a system restarts by itself, and the command that restarts it; empty: its supervisor works."""
    if not is_up(system):
        return "the supervisor is dead; trocar up FILE starts the system again"
    again = "trocar down; then trocar up FILE starts the system again"
    return f"the supervisor is stalled: {again}" if _stalls(system) else ""


def is_reduced(system: str) -> bool:
    """Whether another program has removed shared memory of the system; reports which, and the remedy."""
    if removed := removed_words(system):
        note(f"{removed}; {MEMORY_REMOVED.remedy}")
    return bool(removed)


def _stalls(system: str) -> bool:
    """Whether the heartbeat of the supervisor is old, also at a second look: after a suspend all are old."""
    with contextlib.suppress(SegmentError), contextlib.closing(ControlPage(system, SUPERVISOR)) as page:
        beat = int(page.get("heartbeat_ns"))
        if beat and monotonic_ns() - beat > STALLED_NS:
            pause(LOOK_AGAIN_S)
            return int(page.get("heartbeat_ns")) == beat
    return False


def those_up(known: Iterable[str]) -> list[str]:
    """Systems with a live supervisor: reads the page of each, and /proc once for all."""
    names = sorted(known)
    paged = {system for system in names if _as_its_page_says(system)}
    listed = _as_listed(running()) if len(paged) < len(names) else {}
    return [system for system in names if system in paged or system in listed]


def all_up() -> list[str]:
    """The running systems of this machine that we may read."""
    return those_up(_permitted())


def forbidden(system: str, ours: Sequence[str] | None = None) -> str:
    """Why we may not read another user's system, in words; empty: we may, or it does not exist.

    `ours`: its segments of accepted owners, if they are known.
    """
    ours = _named(system).get(system, []) if ours is None else ours
    owner = "" if any(os.access(path_of(name), os.R_OK) for name in ours) else other_owner(system, ours)
    hint = "its `group` decides who else may attach" if ours else OF_FOREIGN
    return f"not permitted: system {system} belongs to {owner}; {hint}" if owner else ""


def other_owner(system: str, ours: Sequence[str] = ()) -> str:
    """The owner of a system ("user bob"); empty: us, or it does not exist. `ours` as in `forbidden`."""
    theirs = ours or _named(system).get(system) or _named(system, foreign=True).get(system, [])
    return next(filter(None, map(owner_of, theirs)), "")


def is_simulated(system: str) -> bool:
    """Whether the system runs on simulated time."""
    return (system, SUPERVISOR, "clock") in parts_of(system)


def chosen_system(name: str | None = None) -> str:
    """The selected system: `name` if given, else the only one up; Problem names the existing ones.

    A named system may be dead: its remains can still be read.
    """
    if name:
        if why := forbidden(name):
            raise Problem(why)
        if (name, SUPERVISOR, "document") not in names_of(name) and not is_up(name):
            raise Problem(f"no system {name} is up; {_there_are(all_up())}")
        return name
    known = _permitted()
    up = those_up(known)
    if len(up) == 1:
        return up[0]
    if up:
        raise Problem(f"several systems are up: {', '.join(up)}; choose one with --system or TROCAR_SYSTEM")
    left = f" ({', '.join(known)} crashed and left shared memory: trocar down removes it)" if known else ""
    raise Problem(f"no system is up{left}; trocar up starts one{_of_others()}")


def chosen_or_earlier(verb: str) -> str:
    """The only system up; Problem where none is: how `verb` reads the files of those that were up last."""
    kept = sorted(log_folder(os.environ, "any").parent.glob("*/supervisor.log"), key=_changed, reverse=True)
    if all_up() or not kept:
        return chosen_system()
    raise Problem(f"no system is up; trocar {verb} --system NAME shows an earlier one: "
                  f"{', '.join(path.parent.name for path in kept[:LAST])}")


def _changed(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


def _named(system: str | None = None, *, foreign: bool = False) -> dict[str, list[str]]:
    """The segments of each system, from one look at all names."""
    found: dict[str, list[str]] = {}
    for parts in names_of(system, foreign=foreign):
        found.setdefault(parts[0], []).append(segment_name(*parts))
    return found


def _documented(named: Mapping[str, Sequence[str]]) -> list[str]:
    """Those that have, or had, a supervisor that got as far as the document."""
    return sorted(system for system, names in named.items() if segment_name(system, SUPERVISOR, "document") in names)


def _permitted() -> list[str]:
    """Systems that we may look at, up or left over, except those in our own memory: they are chosen by name only."""
    named = _named()
    found = [system for system in _documented(named)
             if not private.is_kept(system) and not forbidden(system, named[system])]
    unlisted = [system for system in held_names() if system not in found]
    listed = _as_listed(running()) if unlisted else {}
    return sorted(found + [system for system in unlisted if system in listed and (
        not forbidden(system, named[system]) if system in named else _runs_for_us(listed[system].pid))])


def _runs_for_us(pid: int) -> bool:
    """Whether a process belongs to our user or the service user; memory that is gone does not tell who may attach."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}").stat().st_uid in owners.accepted() - {0} | {os.getuid()}
    return False


def _of_others() -> str:
    """Message about systems of other users: those of accepted users by name, only the number of all others."""
    ours, theirs = _named(), _documented(_named(foreign=True))
    reported = [why for system in _documented(ours) if (why := forbidden(system, ours[system]))]
    if theirs:
        there = "1 system of another user is" if len(theirs) == 1 else f"{len(theirs)} systems of other users are"
        reported.append(f"{there} there; {OF_FOREIGN}")
    return f" ({'. '.join(reported)})" if reported else ""


def _there_are(names: list[str]) -> str:
    return f"up are {', '.join(names)}" if names else "none is running; trocar up starts one"


def left_over(name: str | None = None) -> list[str]:
    """Systems with segments in shared memory, or processes, without a supervisor (makes system calls)."""
    named = _named(name)
    found = {*named, *(process.system for process in running(name))}
    ours = [system for system in found if not forbidden(system, named.get(system, []))]
    up = those_up(ours)
    return sorted(system for system in ours
                  if system not in up and not held(segment_name(system, SUPERVISOR, "control")))


def instances_of_kind(system: str, kind: str) -> list[str]:
    """Instances of a kind, from the data in their state rings."""
    return [name for _, name, what in parts_of(system)
            if what == "state" and state_info(system, name).get("kind") == kind]


def state_info(system: str, name: str) -> dict[str, Any]:
    """The header data of an instance's state ring; any content is possible. Empty: there is none."""
    try:
        with Segment(segment_name(system, name, "state")) as segment:
            return dict(segment.header.info)
    except (SegmentError, ValueError, KeyError, TypeError, AttributeError):
        return {}


def unknown(what: str, name: str, known: Iterable[str], owner: str = "") -> Problem:
    """The error for a name that is not there: the nearest ones, or all when there are few."""
    return Problem(none_such(what, name, known, owner))
