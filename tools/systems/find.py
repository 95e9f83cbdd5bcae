"""Running systems, the selected one, and the remains of crashed ones."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from trocar.procs.crtk.names import none_such
from trocar.procs.machine.paths import ROOT, given_file, not_found
from trocar.shm.memory import private
from trocar.shm.memory.owners import SERVICE_USER
from trocar.shm.memory.segment import (
    Identity,
    Segment,
    SegmentError,
    held,
    names_of,
    owner_of,
    path_of,
    segment_name,
    start_time,
    unlink,
)
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.control_page import ControlPage
from trocar.tools.output.errors import Problem
from trocar.tools.systems.processes import SUPERVISOR, RunningProcess, running

STALLED_NS = 1_000_000_000  # the supervisor beats every 20 ms
LOOK_AGAIN_S = 0.1


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
    if not identity.pid or start_time(identity.pid) != identity.start:
        return False
    try:
        text = Path(f"/proc/{identity.pid}/stat").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return False
    return text.rsplit(")", 1)[1].split()[0] not in ("Z", "X")


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


def forbidden(system: str) -> str:
    """Why we may not read another user's system, in words; empty: we may, or it does not exist."""
    return _forbidden(system, [segment_name(*parts) for parts in names_of(system)])


def _forbidden(system: str, ours: Sequence[str]) -> str:
    """The same, when its segments of accepted owners are known."""
    owner, hint = _denied(system, ours)
    return f"not permitted: system {system} belongs to {owner}; {hint}" if owner else ""


def _denied(system: str, ours: Sequence[str]) -> tuple[str, str]:
    """Owner of a system that we may not read, and the rule that decides; both empty: we may."""
    if any(os.access(path_of(name), os.R_OK) for name in ours):
        return "", ""
    return _owner(system, ours), ("its `group` decides who else may attach" if ours else
                                  f"{SERVICE_USER} names a user to trust")


def other_owner(system: str) -> str:
    """The owner of a system ("user bob"); empty: us, or it does not exist."""
    return _owner(system, [segment_name(*parts) for parts in names_of(system)])


def _owner(system: str, ours: Sequence[str]) -> str:
    """The same, when its segments of accepted owners are known."""
    theirs = ours or [segment_name(*parts) for parts in names_of(system, foreign=True)]
    return next(filter(None, map(owner_of, theirs)), "")


def is_simulated(system: str) -> bool:
    """Whether the system runs on simulated time."""
    return (system, SUPERVISOR, "clock") in names_of(system)


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
    return [system for system in _documented(named)
            if not private.is_kept(system) and not _forbidden(system, named[system])]


def _of_others() -> str:
    """Message about systems of other users."""
    ours, theirs = _named(), _named(foreign=True)
    found = sorted({*_documented(ours), *_documented(theirs)})
    theirs_by_hint: dict[str, list[str]] = {}
    for system in found:
        owner, hint = _denied(system, ours.get(system, []))
        if owner:
            theirs_by_hint.setdefault(hint, []).append(f"system {system} belongs to {owner}")
    reported = [f"not permitted: {', '.join(names)}; {hint}" for hint, names in theirs_by_hint.items()]
    return f" ({'. '.join(reported)})" if reported else ""


def _there_are(names: list[str]) -> str:
    return f"up are {', '.join(names)}" if names else "none is; trocar up starts one"


def left_over(name: str | None = None) -> list[str]:
    """Systems with segments in shared memory, or processes, without a supervisor (makes system calls)."""
    named = _named(name)
    found = {*named, *(process.system for process in running(name))}
    ours = [system for system in found if not _forbidden(system, named.get(system, []))]
    up = those_up(ours)
    return sorted(system for system in ours
                  if system not in up and not held(segment_name(system, SUPERVISOR, "control")))


def clear(system: str) -> int:
    """Remove every segment of a crashed system; returns their number."""
    names = names_of(system)
    for part in names:
        unlink(segment_name(*part))
    return len(names)


def instances_of_kind(system: str, kind: str) -> list[str]:
    """Instances of a kind, from the data in their state rings."""
    found = []
    for owner, instance, what in names_of(system):
        if what == "state":
            with contextlib.suppress(SegmentError), Segment(segment_name(owner, instance, what)) as segment:
                if segment.header.info.get("kind") == kind:
                    found.append(instance)
    return found


def unknown(what: str, name: str, known: Iterable[str], owner: str = "") -> Problem:
    """The error for a name that is not there: the nearest ones, or all when there are few."""
    return Problem(none_such(what, name, known, owner))
