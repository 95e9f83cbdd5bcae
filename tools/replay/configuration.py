"""The configuration of a recording, made fit to be started again: no real robot, in lock-step, without an audience."""

from __future__ import annotations

import dataclasses
from typing import Final

from trocar.procs.document.system import LOCKSTEP, WALL, IoConfig, SystemConfig, from_json, to_json
from trocar.procs.recordings.reading import RecordingReader
from trocar.tools.analysis.choosing import TIMED
from trocar.tools.output.errors import Problem

LOOPBACK: Final = ("udp:127.", "udpfw:127.")


def recorded_system(recording: RecordingReader) -> SystemConfig:
    """The recorded configuration; Problem if there is none, or it cannot be read."""
    name = recording.path.name
    if not recording.document:
        raise Problem(f"{name} has no configuration: only its setpoints can be sent (trocar replay without --fresh)")
    try:
        return from_json(recording.document)
    except ValueError as error:
        raise Problem(f"{name}: {error}; it was recorded by another version") from None


def is_real(system: SystemConfig, io: IoConfig) -> bool:
    """Whether a bus leads to boards that are not emulated."""
    return bool(io.port) and not (system.emulation is not None and io.port.startswith(LOOPBACK))


def startable(system: SystemConfig) -> tuple[bytes, tuple[str, ...]]:
    """The document to start, and the processes left out of it; Problem for a real robot.

    Left out are processes that simulated time does not wait for: their commands are sent in their place.
    """
    if system.clock == WALL:
        raise Problem("it was recorded on real time, which no run repeats; what ran in simulated time (paced, "
                      "lockstep) can be repeated, other recordings can be sent to a running system")
    real = [io.name for io in system.ios if is_real(system, io)]
    if real or system.third_parties:
        names = ", ".join((*real, *(row.name for row in system.third_parties)))
        raise Problem(f"{names}: not emulated; only emulated and KINEMATIC robots are started again")
    out = tuple(row.name for row in system.processes if row.kind not in TIMED)
    kept = tuple(dataclasses.replace(row, cpus=(), after=tuple(name for name in row.after if name not in out))
                 for row in system.processes if row.name not in out)
    return to_json(dataclasses.replace(
        system, clock=LOCKSTEP, processes=kept, users=(), ros=None, socket=None, foxglove=None, gui=None, cpus=(),
        group="", service_user="")), out
