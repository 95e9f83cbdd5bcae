"""Which systems are up, which one is meant, and what dead ones have left behind."""

from __future__ import annotations

import contextlib
import difflib
from collections.abc import Iterable
from pathlib import Path

from shm.clock import pause
from shm.directory import systems
from shm.owners import SERVICE_USER
from shm.segment import (
    Identity,
    Segment,
    SegmentError,
    foreign_owner,
    names_of,
    segment_name,
    start_time,
    unlink,
)
from tools.errors import Problem

BEING_MADE_S = 0.5
ROOT = Path(__file__).resolve().parents[1]


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
    """Who supervises a system, or did; None when there is no such system."""
    try:
        with Segment(segment_name(system, "supervisor", "control")) as segment:
            return segment.identity()
    except SegmentError:
        return None


def is_up(system: str) -> bool:
    """Whether a living supervisor holds the system."""
    identity = supervisor_of(system)
    return identity is not None and alive(identity)


def is_lockstep(system: str) -> bool:
    """Whether the system runs on simulated time."""
    return (system, "supervisor", "clock") in names_of(system)


def chosen_system(name: str | None = None) -> str:
    """The system meant: `name` when given, else the only one up; Problem says what there is.

    A named system may be dead: what it left can still be looked at.
    """
    known = systems()
    if name:
        if name not in known:
            raise Problem(f"no system {name} is up; {_there_are([s for s in known if is_up(s)])}{_of_others(name)}")
        return name
    up = [s for s in known if is_up(s)]
    if len(up) == 1:
        return up[0]
    if up:
        raise Problem(f"several systems are up: {', '.join(up)}; choose one with --system or TROCAR_SYSTEM")
    left = f" ({', '.join(known)} died and left shared memory: trocar down clears it)" if known else ""
    raise Problem(f"no system is up{left}; trocar up starts one{_of_others()}")


def _of_others(name: str | None = None) -> str:
    """What is to be said of systems of users whose shared memory is not accepted."""
    found = sorted({(s, foreign_owner(segment_name(s, i, what))) for s, i, what in names_of(name, foreign=True)
                    if (i, what) == ("supervisor", "document")})
    said = [f"{system} belongs to {user}" for system, user in found if user]
    return f" ({', '.join(said)}; {SERVICE_USER} names a user to trust)" if said else ""


def _there_are(names: list[str]) -> str:
    return f"up are {', '.join(names)}" if names else "none is; trocar up starts one"


def left_over(name: str | None = None) -> list[str]:
    """Systems with segments in shared memory and nobody who supervises them (asks the kernel for the claim)."""
    found = sorted({system for system, _, _ in names_of(name)})
    return [system for system in found if not _held(system)]


def _held(system: str) -> bool:
    """A supervisor makes its memory first and claims it a moment later: what nobody ever claimed is looked at twice."""
    try:
        with Segment(segment_name(system, "supervisor", "control")) as segment:
            if segment.claimed():
                return True
            if segment.identity().pid == 0:
                pause(BEING_MADE_S)
            return segment.claimed()
    except SegmentError as error:
        return "no such segment" not in str(error)  # another user's, or not readable: not ours to clear


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
