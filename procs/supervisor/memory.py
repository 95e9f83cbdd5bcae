"""All shared memory of a system: made before the first process starts, removed after the last has ended."""

from __future__ import annotations

import contextlib
import errno
import functools
import grp
import math
import os
import socket
from bisect import bisect_right
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

from trocar.procs.crtk.user_rows import own_commands, topics_of
from trocar.procs.document.system import PACED, WALL, Process, SystemConfig, to_json
from trocar.procs.machine.verb_lines import verb_line
from trocar.procs.tables.manifest import IN_TIME, THIRD_PARTY, proc
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.generations import create_faults, robot_component
from trocar.shm.mailbox.mailbox_map import create_mailbox
from trocar.shm.memory.layout import Schema
from trocar.shm.memory.owners import SERVICE_USER
from trocar.shm.memory.parts import remove_all
from trocar.shm.memory.removed import KeptSegments, address
from trocar.shm.memory.segment import (
    FOLDER,
    Make,
    Segment,
    SegmentError,
    SegmentFull,
    create,
    free_bytes,
    held,
    names_of,
    owner_of,
    path_of,
    segment_name,
    size_of,
)
from trocar.shm.system import directory
from trocar.shm.system.subscriptions import Clearing
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.control_page import ControlPage, create_control
from trocar.shm.time.lockstep import Table, create_clock
from trocar.shm.topics import Topic

ORPHANS_NS: Final = 10_000_000_000
POLL_S: Final = 0.05
MEGABYTE: Final = 1e6
CLEAR_NS: Final = 200_000_000
STEP_S: Final = 0.01
"""Step in which the history of rings is shortened."""
RESERVE: Final = 2_000_000
MAX_RESERVED: Final = 32_000_000
RESERVED_PART: Final = 0.05
"""Shared memory left to other programs: this part of the file system, but at least and at most these bytes."""


def hold_name(name: str) -> socket.socket:
    """Hold the system's name for as long as we live; SegmentError names the supervisor that has it.

    An abstract Unix socket: it is taken atomically (by only one of two `up`), and released by the Linux kernel.
    """
    lock = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET | socket.SOCK_NONBLOCK)
    try:
        lock.bind(address(name))
    except OSError as error:
        lock.close()
        if error.errno != errno.EADDRINUSE:
            raise
        raise SegmentError(f"system {name} is up already{_holder(name)}") from None
    return lock


def _holder(name: str) -> str:
    """The holder of the name, and the remedy."""
    control = segment_name(name, "supervisor", "control")
    try:
        with Segment(control) as segment:
            return f" (supervisor pid {segment.identity().pid}); {verb_line('down', name)} stops it"
    except SegmentError:
        user = owner_of(control)
        if user:
            return f", of {user}; choose another name (--system)"
        return " (it is just starting or ending, or another program holds its name); try again, or choose another name"


def clear_left_over(name: str) -> int:
    """Remove segments that a dead supervisor of this name left, once its processes have ended; returns their number.

    These processes notice its death and end by themselves; SegmentError names those that do not. Hold the name first.
    """
    end = monotonic_ns() + ORPHANS_NS
    while orphans := _orphans(name):
        if monotonic_ns() >= end:
            raise SegmentError(f"processes of an earlier {name} still run: {', '.join(orphans)}; "
                               f"{verb_line('down', name)} ends them")
        pause(POLL_S)
    return remove_all(name)


def _orphans(name: str) -> list[str]:
    found = []
    for system, instance, what in names_of(name):
        if what == "control" and not _is_third_party(system, instance):
            page = segment_name(system, instance, what)
            try:
                with Segment(page) as segment:
                    if segment.claimed():
                        found.append(f"{instance} (pid {segment.identity().pid})")
            except SegmentError:  # not ours, or of another version, whose processes may still live
                if held(page):
                    found.append(f"{instance} (of another version; see fuser -v /dev/shm{page})")
    return found


def _is_third_party(system: str, instance: str) -> bool:
    """Whether it is a third-party program that was started elsewhere: it does not block a new system of this name."""
    try:
        with Segment(segment_name(system, instance, "state")) as segment:
            info = segment.header.info
            return info.get("kind") in THIRD_PARTY and not info.get("starts")
    except SegmentError:
        return False


def maker(group: str) -> Make:
    """The function that makes segments: for our user alone, or for a group of this machine as well."""
    return functools.partial(create, mode=0o660, group=_gid(group)) if group else create


def _gid(group: str) -> int:
    return grp.getgrnam(group).gr_gid if group else -1


def trust(service_user: str) -> None:
    """Accept segments of this user, too, here and in all processes we start; empty: leave the environment unchanged."""
    if service_user:
        os.environ[SERVICE_USER] = service_user


def history_s(system: SystemConfig) -> float:
    """Time that the rings of a system keep: by its kind of robot, or less where shared memory is short."""
    usual_s = directory.HISTORY_S if any(io.port for io in system.ios) else directory.KINEMATIC_HISTORY_S
    return system.history_s or usual_s


def fitted(system: SystemConfig) -> SystemConfig:
    """The system with as much history as there is room for, at most the usual one; SegmentFull below the minimum.

    A reserve is left to other programs.
    """
    system = replace(system, history_s=0.0, shortage="")
    usual, free, usual_s = needed(system), free_bytes(system.name), history_s(system)
    room = free - reserve()
    if usual <= room:
        return system

    def short(step: int) -> SystemConfig:
        kept_s = step * STEP_S
        return replace(system, history_s=kept_s, shortage=(
            f"rings keep {kept_s:.2f} s instead of {usual_s:.2f} s: {free / MEGABYTE:.1f} MB of shared memory were "
            f"free, {usual / MEGABYTE:.1f} MB are needed and {reserve() / MEGABYTE:.1f} MB for other programs; "
            f"{_larger(usual - room)}"))

    steps = range(round(directory.MIN_HISTORY_S / STEP_S), round(usual_s / STEP_S))
    fitting = bisect_right(steps, room, key=lambda step: needed(short(step)))
    if not fitting:
        raise SegmentFull(_no_room(system.name, needed(short(steps[0])), free, usual))
    return short(steps[fitting - 1])


def needed(system: SystemConfig) -> int:
    """Bytes of shared memory that the system needs."""
    sizes = _sizes(system)
    return sum(sizes.values()) + directory.create_document(system.name, len(to_json(system)), size_of, sizes)


def _sizes(system: SystemConfig) -> dict[str, int]:
    """Bytes of every segment but the document, by name."""
    found: dict[str, int] = {}

    def note(name: str, kind: str, schema: Schema, depth: int, info: dict[str, Any] | None = None) -> int:
        found[name] = size = size_of(name, kind, schema, depth, info)
        return size

    create_rest(system, note)
    if system.clock != WALL:
        create_clock(system.name, simulated(system), note)
    return found


def kept(system: SystemConfig, lock: socket.socket) -> KeptSegments:
    """Keeps all segments of the system for programs that find no name of one; `lock`: from `hold_name`."""
    names = [segment_name(*parts) for parts in names_of(system.name)]
    return KeptSegments(lock, system.name, {name: path_of(name) for name in names}, _gid(system.group))


def simulated(system: SystemConfig) -> Table:
    """The members of simulated time: kinds that run in time. The boards do not answer io's writes."""
    members = [row.name for row in system.processes if row.kind in IN_TIME]
    return Table(tuple(members), next((row.name for row in proc("boards").instances(system)), ""),
                 tuple(io.name for io in system.ios if io.port), system.clock == PACED)


def create_all(system: SystemConfig, make: Make = create) -> int:
    """Make every segment of the system except the clock; returns the total size in bytes. An error leaves no segment.

    SegmentFull when there is no room.
    """
    with whole_or_none(system):
        return create_rest(system, make) + publish(system, make)


@contextlib.contextmanager
def whole_or_none(system: SystemConfig) -> Iterator[None]:
    """An error removes every segment; SegmentFull names the size of the system."""
    try:
        yield
    except BaseException as error:
        remove_all(system.name)
        if isinstance(error, SegmentFull):  # another program took the memory meanwhile
            total, free = needed(system), free_bytes(system.name)
            raise SegmentFull(_no_room(system.name, total, free, total)) from None
        raise


def publish(system: SystemConfig, make: Make) -> int:
    """Make the document, with the list of all segments, when they exist; returns its size."""
    return directory.publish_document(system.name, to_json(system), make, _sizes(system))


def _no_room(name: str, total: int, free: int, usual: int) -> str:
    others = reserve()
    return (f"shared memory is full: system {name} needs {total / MEGABYTE:.1f} MB and {others / MEGABYTE:.1f} MB for "
            f"other programs, {free / MEGABYTE:.1f} MB are free in {FOLDER}; clear what is left there (trocar down, "
            f"ls -l {FOLDER}), or {_larger(usual + others - free)}")


def _larger(missing: int) -> str:
    """How to get more shared memory."""
    needs = (_size() + math.ceil(max(0, missing) / (1.0 - RESERVED_PART)) >> 20) + 1
    return f"make {FOLDER} larger (as root: mount -o remount,size={needs}M {FOLDER}; a container: --shm-size={needs}m)"


def reserve() -> int:
    """Bytes of shared memory that a system leaves to other programs."""
    return min(MAX_RESERVED, max(RESERVE, round(RESERVED_PART * _size())))


def _size() -> int:
    """Of the file system of shared memory, bytes."""
    status = os.statvfs(FOLDER)
    return status.f_blocks * status.f_frsize


def create_rest(system: SystemConfig, make: Make) -> int:
    """Make every segment but document and clock; returns the total size in bytes."""
    total = create_faults(system.name, components(system), make)
    supervisor = Process("supervisor", "supervisor", proc("supervisor").period_s)
    return total + sum(_create_instance(system, process, make) for process in (supervisor, *system.processes))


def components(system: SystemConfig) -> list[str]:
    """Components whose faults are counted: arms (also from ROS), setup joints, and the robots of every io."""
    arms = [row.name for rows in (system.arms, system.carts) for row in rows]
    arms += [row.name for row in system.third_parties if row.ros is not None]
    return arms + [robot_component(io.name, robot.name) for io in system.ios for robot in io.robots]


def _create_instance(system: SystemConfig, process: Process, make: Make) -> int:
    row, user = proc(process.kind), system.user(process.name)
    audit = ("audit",) if process.kind in COMMANDS or row.declared else ()
    declared = topics_of(user) if user is not None else ()
    topics = [directory.topic_of(process.kind, name) for name in (*row.topics, "events", *audit)]
    total = create_control(system.name, process.name, make, [*topics, *declared])
    if audit:
        total += create_mailbox(system.name, process.name, process.kind, COMMANDS.get(process.kind, ()), make,
                                wakes=row.woken, own=own_commands(system, process.name))
    for own in declared:
        total += directory.create_ring(system.name, process.name, own, {}, {"kind": process.kind}, make)
    dims, info = row.sizes(system, process.name)
    for topic in topics:
        total += directory.create_ring(
            system.name, process.name, topic, {} if topic.writer == "*" else dims,
            {"kind": process.kind, "rate_hz": _rate_hz(topic, process), **info}, make, history_s(system))
    return total


def _rate_hz(topic: Topic, process: Process) -> float:
    """A topic at the usual rate of its kind has a record per cycle, so it comes at the configured rate of its process.
    """
    is_of_each_cycle = process.period_s > 0.0 and math.isclose(topic.rate_hz * proc(process.kind).period_s, 1.0)
    return round(1.0 / process.period_s, 3) if is_of_each_cycle else topic.rate_hz


class Clearings:
    """Clears the subscriptions of dead clients on all control pages, every CLEAR_NS."""

    def __init__(self, system: SystemConfig) -> None:
        """The control pages must exist."""
        names = ("supervisor", *(row.name for row in system.processes))
        self._clearings = [Clearing(ControlPage(system.name, name, write=True)) for name in names]
        self._due_ns = 0

    def beat(self, now_ns: int) -> None:
        """Clear subscriptions of dead clients, when due."""
        if now_ns >= self._due_ns:
            self._due_ns = now_ns + CLEAR_NS
            for clearing in self._clearings:
                clearing.clear()
