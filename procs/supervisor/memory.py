"""All shared memory of a system: made before anything starts, removed after everything has ended."""

from __future__ import annotations

import contextlib
import errno
import socket
from typing import Any, Final

from procs.lib.document import Io, Process, System, to_json
from procs.manifest import proc
from shm import directory
from shm.clock import monotonic_ns, pause
from shm.commands import COMMANDS
from shm.mailbox import create_mailbox
from shm.pulse import create_control
from shm.segment import Segment, SegmentError, names_of, segment_name, unlink

ORPHANS_NS: Final = 10_000_000_000
POLL_S: Final = 0.05
Dims = dict[str, int]
Info = dict[str, Any]


def sizes(system: System, process: Process) -> tuple[Dims, Info]:
    """Named sizes of an instance's records and the constants that explain them (cuts of robots, names)."""
    if process.kind == "io":
        return _of_ios((system.io(process.name),))
    if process.kind == "boards" and system.emulation is not None:
        dims, info = _of_ios(system.ios)
        boards = [c.board_id for bus in system.emulation.buses for c in bus.controllers]
        return {"axes": dims["axes"], "boards": len(boards)}, {"robots": info["robots"], "boards": boards}
    if process.kind == "supervisor":
        return {"instances": len(system.processes)}, {"instances": [p.name for p in system.processes]}
    return {}, {}


def _of_ios(ios: tuple[Io, ...]) -> tuple[Dims, Info]:
    robots, first, inputs = {}, 0, []
    for io in ios:
        names = {pid.robot: [axis.name for axis in pid.axes] for pid in io.pids}
        for robot in io.robots:
            count = len(robot.actuators)
            labels = names.get(robot.name) or [f"actuator_{i}" for i in range(count)]
            robots[robot.name] = {"first": first, "count": count, "names": labels, "io": io.name}
            first += count
        inputs += [i.name for i in io.digital_inputs]
    return {"axes": first, "robots": len(robots), "inputs": len(inputs)}, {"robots": robots, "inputs": inputs}


def hold_name(name: str) -> socket.socket:
    """Hold the system's name for as long as we live; SegmentError names the supervisor that has it.

    An abstract Unix socket: taking it is one step (two `up` at once cannot both have it), and the kernel gives it back.
    """
    lock = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    try:
        lock.bind(f"\0trocar~{name}")
    except OSError as error:
        lock.close()
        if error.errno != errno.EADDRINUSE:
            raise
        raise SegmentError(f"system {name} is up already{_pid_of(name)}; trocar down stops it") from None
    return lock


def _pid_of(name: str) -> str:
    try:
        with Segment(segment_name(name, "supervisor", "control")) as segment:
            return f" (supervisor pid {segment.identity().pid})"
    except SegmentError:
        return " (it is just starting or ending)"


def clear_left_over(name: str) -> int:
    """Remove what a dead supervisor of this name left, when its processes have ended; returns the number of segments.

    They notice its death by themselves and end in order. SegmentError names those that do not. Hold the name before.
    """
    end = monotonic_ns() + ORPHANS_NS
    while orphans := _orphans(name):
        if monotonic_ns() >= end:
            raise SegmentError(f"processes of an earlier {name} still run: {', '.join(orphans)}; kill them first")
        pause(POLL_S)
    found = names_of(name)
    for system, instance, what in found:
        unlink(segment_name(system, instance, what))
    return len(found)


def _orphans(name: str) -> list[str]:
    found = []
    for system, instance, what in names_of(name):
        if what == "control":
            with contextlib.suppress(SegmentError), Segment(segment_name(system, instance, what)) as segment:
                if segment.claimed():
                    found.append(f"{instance} (pid {segment.identity().pid})")
    return found


def create_all(system: System, group: int = -1) -> int:
    """Make every segment of the system; returns the total size in bytes. On error nothing is left."""
    mode = 0o660 if group >= 0 else 0o600
    try:
        total = create_control(system.name, "supervisor", mode=mode, group=group)
        total += directory.publish_document(system.name, to_json(system), mode=mode, group=group)
        supervisor = Process("supervisor", "supervisor", proc("supervisor").period_s)
        for process in (supervisor, *system.processes):
            total += _create_instance(system, process, mode, group)
    except BaseException:
        for name, instance, what in names_of(system.name):
            unlink(segment_name(name, instance, what))
        raise
    return total


def _create_instance(system: System, process: Process, mode: int, group: int) -> int:
    total = 0
    if process.kind != "supervisor":
        total += create_control(system.name, process.name, mode=mode, group=group)
    if process.kind in COMMANDS:
        total += create_mailbox(system.name, process.name, process.kind, mode=mode, group=group)
    dims, info = sizes(system, process)
    topics = ("state",) if process.kind == "supervisor" else proc(process.kind).topics
    for topic in (*topics, "events"):
        row = directory.topic_of(process.kind, topic)
        total += directory.create_ring(system.name, process.name, row, dims if topic != "events" else {},
                                       {"kind": process.kind, **info}, mode=mode, group=group)
    return total


def remove_all(name: str) -> None:
    """Remove every segment of a system."""
    for system, instance, what in names_of(name):
        unlink(segment_name(system, instance, what))
