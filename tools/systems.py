"""Which systems are up, which one is meant, and what dead ones have left behind."""

from __future__ import annotations

import contextlib
import difflib
import os
from collections.abc import Iterable, Sequence
from pathlib import Path

from procs.paths import given_file, not_found
from shm.directory import systems
from shm.owners import SERVICE_USER
from shm.segment import (
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
from tools.errors import Problem
from tools.running import SUPERVISOR, running

ROOT = Path(__file__).resolve().parents[1]


def environment() -> dict[str, str]:
    """Ours, with the project found whatever the working folder is (which relative paths are meant for)."""
    rest = os.environ.get("PYTHONPATH", "")
    return {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{rest}" if rest else str(ROOT)}


def system_file(file: Path, path: Sequence[Path] = ()) -> Path:
    """A system file as a person names it, also along `--path` and in configs/; Problem when there is none."""
    found = given_file(file, path)
    if not found.exists():
        raise Problem(f"{file}: {not_found(file, path)}")
    return found


def alive(identity: Identity) -> bool:
    """Whether the process that claimed a segment last still lives. Asks /proc only: it takes no lock of anybody."""
    if not identity.pid or start_time(identity.pid) != identity.start:
        return False
    try:
        text = Path(f"/proc/{identity.pid}/stat").read_text()
    except OSError:
        return False
    return text.rsplit(")", 1)[1].split()[0] not in ("Z", "X")


def supervisor_of(system: str) -> Identity | None:
    """Who supervises a system: as its control page says, or where that is no help, as the kernel lists it."""
    with contextlib.suppress(SegmentError), Segment(segment_name(system, SUPERVISOR, "control")) as segment:
        identity = segment.identity()
        if alive(identity) and segment.claimed():
            return identity
    found = [process for process in running(system) if process.instance == SUPERVISOR]
    return Identity(found[0].pid, 0, found[0].start, SUPERVISOR) if found else None


def is_up(system: str) -> bool:
    """Whether a living supervisor holds the system."""
    return supervisor_of(system) is not None


def forbidden(system: str) -> str:
    """Why we may not look at a system of somebody else, in words; empty: we may, or it is not there."""
    ours = [segment_name(*parts) for parts in names_of(system)]
    if any(os.access(path_of(name), os.R_OK) for name in ours):
        return ""
    theirs = ours or [segment_name(*parts) for parts in names_of(system, foreign=True)]
    owner = next(filter(None, map(owner_of, theirs)), "")
    hint = "its `group` decides who else may attach" if ours else f"{SERVICE_USER} names a user to trust"
    return f"not permitted: system {system} belongs to {owner}; {hint}" if owner else ""


def is_simulated(system: str) -> bool:
    """Whether the system runs on simulated time."""
    return (system, SUPERVISOR, "clock") in names_of(system)


def chosen_system(name: str | None = None) -> str:
    """The system meant: `name` when given, else the only one up; Problem says what there is.

    A named system may be dead: what it left can still be looked at.
    """
    if name:
        if why := forbidden(name):
            raise Problem(why)
        if name not in systems() and not is_up(name):
            raise Problem(f"no system {name} is up; {_there_are([s for s in _permitted() if is_up(s)])}")
        return name
    known = _permitted()
    up = [s for s in known if is_up(s)]
    if len(up) == 1:
        return up[0]
    if up:
        raise Problem(f"several systems are up: {', '.join(up)}; choose one with --system or TROCAR_SYSTEM")
    left = f" ({', '.join(known)} died and left shared memory: trocar down clears it)" if known else ""
    raise Problem(f"no system is up{left}; trocar up starts one{_of_others()}")


def _permitted() -> list[str]:
    return [system for system in systems() if not forbidden(system)]


def _of_others() -> str:
    """What is to be said of systems of other users."""
    listed = (*names_of(foreign=True), *names_of())
    found = sorted({system for system, instance, what in listed if (instance, what) == (SUPERVISOR, "document")})
    reported = [why for system in found if (why := forbidden(system))]
    return f" ({'. '.join(reported)})" if reported else ""


def _there_are(names: list[str]) -> str:
    return f"up are {', '.join(names)}" if names else "none is; trocar up starts one"


def left_over(name: str | None = None) -> list[str]:
    """Systems with segments in shared memory, or processes, and nobody who supervises them (asks the kernel)."""
    found = {system for system, _, _ in names_of(name)} | {process.system for process in running(name)}
    return sorted(system for system in found if not forbidden(system) and not is_up(system)
                  and not held(segment_name(system, SUPERVISOR, "control")))


def clear(system: str) -> int:
    """Remove every segment of a dead system; returns their number."""
    names = names_of(system)
    for part in names:
        unlink(segment_name(*part))
    return len(names)


def instances_of_kind(system: str, kind: str) -> list[str]:
    """Instances of a kind, from what their state rings say of themselves."""
    found = []
    for owner, instance, what in names_of(system):
        if what == "state":
            with contextlib.suppress(SegmentError), Segment(segment_name(owner, instance, what)) as segment:
                if segment.header.info.get("kind") == kind:
                    found.append(instance)
    return found


def unknown(what: str, name: str, known: Iterable[str]) -> Problem:
    """The error for a name that is not there: the nearest ones, or all when there are few."""
    names = list(known)
    near = difflib.get_close_matches(name, names, 3, 0.5) or (names if len(names) <= 8 else names[:8] + ["…"])
    return Problem(f"no {what} {name}; " + (f"near are: {', '.join(near)}" if near else "there is none at all"))
