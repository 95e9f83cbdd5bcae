"""The robot of an environment as a host in this process (procs/host): its episodes begin from snapshots."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import logging
import os
from collections.abc import Sequence
from typing import Final

import numpy as np

from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.document.arms import ArmConfig
from trocar.procs.document.system import LOCKSTEP, SystemConfig
from trocar.procs.host.host import Host
from trocar.procs.host.snapshot import HostSnapshot
from trocar.procs.kinematics.poses import Array
from trocar.procs.rl.backend import BOARDS, RobotBackend, RobotStopped
from trocar.procs.rl.link import ArmLink
from trocar.procs.rl.model import ArmModel, StartPose
from trocar.procs.tables.arm_types import base_name
from trocar.shm.commands import became

Values = Array | tuple[float, ...]

PERIOD_S: Final = 0.002
"""For io, arms and the physics of emulated robots, default."""
COARSEST_S: Final = 0.002
"""Of the physics of arms on boards: with longer steps the light joints of a wrist ring, and trip."""
FINEST_S: Final = 0.0005
_numbers: Final = itertools.count()


def document(file: str, backend: str, period_s: float, physics_s: float, walls: str = "") -> SystemConfig:
    """A system file of ours in simulated time, under a unique name in this process.

    ValueError for invalid periods or `walls`, which are in YAML, as in a system file.
    """
    if not FINEST_S <= period_s <= COARSEST_S:
        raise ValueError(f"period_s is {period_s:g} s; allowed: {FINEST_S:g} to {COARSEST_S:g} s")
    if not FINEST_S <= physics_s <= COARSEST_S:
        raise ValueError(f"physics_s is {physics_s:g} s; allowed: {FINEST_S:g} to {COARSEST_S:g} s")
    name = f"rl{os.getpid()}x{next(_numbers)}"
    return dataclasses.replace(_loaded(file, backend, period_s, physics_s, walls), name=name)


@functools.lru_cache(maxsize=16)
def _loaded(file: str, backend: str, period_s: float, physics_s: float, walls: str) -> SystemConfig:
    sets = ["clock=lockstep", f"io.period_s={period_s}", f"arm.period_s={period_s}", "recorder.on=false"]
    if walls:
        sets.append(f"walls={walls}")
    if backend == BOARDS:
        sets.append(f"emulation.period_s={physics_s}")
    loaded = load_system(PROJECT_CONFIGS / "systems" / file, name="rl", sets=sets,
                         boards="emulated" if backend == BOARDS else None)
    if loaded.system is None:
        raise ValueError("; ".join(str(error) for error in loaded.errors))
    assert loaded.system.clock == LOCKSTEP
    return loaded.system


FIRST_S: Final = 0.05
"""Until io and arms have seen each other."""
POLL_S: Final = 0.02
LIMIT_S: Final = 120.0
"""A homing or move that takes longer has failed."""
REST_S: Final = 0.25
"""After a move, until the robot is at rest."""


class HostedRobot(RobotBackend):
    """Arms of a system that is in this process from the first episode on.

    Time passes in steps only and waits for us, no other program has access, and a snapshot repairs failures.
    """

    def __init__(self, document: SystemConfig, arms: Sequence[str], jaws: Sequence[float]) -> None:
        """`jaws`: of the starts, one for each arm."""
        self._document, self._pid = document, os.getpid()
        self.models: Sequence[ArmModel] = [_model(document.arm(name), jaw)
                                           for name, jaw in zip(arms, jaws, strict=True)]
        self.frame = document.arm(arms[0]).reference_frame or base_name(arms[0])
        self.links: Sequence[ArmLink] = ()
        self.host: Host | None = None
        self._snapshots: dict[int, HostSnapshot] = {}

    def _open(self) -> Host:
        """The host, homed; its snapshot is number −1. RobotStopped: an arm could not be homed."""
        if os.getpid() != self._pid:
            raise RobotStopped("this environment was made by the process that forked us; make one here")
        if self.host is not None:
            return self.host
        host = Host(self._document)
        try:
            self._home(host)
        except BaseException:
            host.close()
            raise
        self.host = host
        return host

    def _home(self, host: Host) -> None:
        """Home all arms."""
        for name in host.loops:  # their warnings are in `info`; their log needs logging to be configured
            if not logging.getLogger(name).handlers:
                logging.getLogger(name).addHandler(logging.NullHandler())
        self.links = [ArmLink(model.name, host.reader(model.name), host.client(model.name)) for model in self.models]
        host.run(FIRST_S)
        for word in ("enable", "home"):
            self._all(host, "state_command", [()] * len(self.links), word)
        self._snapshots[-1] = host.snapshot()

    def now_ns(self) -> int:
        """The host's time."""
        return self._open().now_ns

    def look(self, number: int) -> str:
        self.links[number].look()
        return self.links[number].problem

    def begin(self, number: int, starts: Sequence[StartPose], seed: int) -> None:
        """See RobotBackend: restore a snapshot, which is made at the first use of this start."""
        host = self._open()
        if number not in self._snapshots:
            host.restore(self._snapshots[-1])
            self._all(host, "move_jp", [start.joints for start in starts])
            self._all(host, "jaw/move_jp", [(start.jaw,) if model.has_jaw else None
                                            for start, model in zip(starts, self.models, strict=True)])
            host.run(REST_S)
            self._snapshots[number] = host.snapshot()
        host.restore(self._snapshots[number], seed)

    def _all(self, host: Host, command: str, values: Sequence[Values | None], text: str = "") -> None:
        """Command all arms at once, except those with None, and let time pass until done."""
        asked = [(link, link.send(command, each, text))
                 for link, each in zip(self.links, values, strict=True) if each is not None]
        end_ns = host.now_ns + round(LIMIT_S * 1e9)
        for link, number in asked:
            while not (ended := link.hear(number)) and host.now_ns < end_ns:
                host.run(POLL_S)
            if ended != "done":
                link.look()
                why = link.refusal or link.reason or "it takes too long"
                raise RobotStopped(f"{link.name}: {text or command} {became(ended or 'not done')}: {why}")

    def wait_until(self, deadline_ns: int) -> None:
        """See RobotBackend: here time passes at once."""
        self._open().run_until(deadline_ns)

    def close(self) -> None:
        """See RobotBackend. In a forked child nothing is done: the host is the parent's."""
        if self.host is not None and os.getpid() == self._pid:
            self.host.close()
            self.host, self.links, self._snapshots = None, (), {}


def _model(arm: ArmConfig, jaw: float) -> ArmModel:
    """For an arm that carries the tool in its file."""
    base = np.eye(4) if arm.base_frame is None else np.array(arm.base_frame)
    return ArmModel(arm, arm.endoscope or (arm.tool.name if arm.tool is not None else ""), base, jaw)
