"""A hand-made system for the tests of the tools: one io, one arm, played by the test itself."""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from trocar.procs.document.system import (
    Actuator,
    ArmConfig,
    Chain,
    DhLink,
    IoConfig,
    JawConfig,
    Linear,
    PidAxis,
    PidConfig,
    Process,
    Recorder,
    Robot,
    SystemConfig,
    Tool,
)
from trocar.procs.supervisor import memory
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.memory.layout import Schema
from trocar.shm.memory.parts import remove_all
from trocar.shm.memory.segment import create
from trocar.shm.system import directory
from trocar.shm.system.events import Events
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import ControlPage

JOINTS = ("yaw", "pitch", "insertion", "roll", "wrist_pitch", "wrist_yaw")
KEPT = 64  # records of each ring: thousands take time to make
IDENTITY = tuple(tuple(float(i == k) for k in range(4)) for i in range(4))


def _link(name: str) -> DhLink:
    return DhLink(name, "revolute", 0.0, 0.0, 0.0, 0.0, 0.0, -1.0, 1.0, 1.0)


def _document(name: str, recordings: Path | None) -> SystemConfig:
    actuator = Actuator(3, 0, "REVOLUTE", 1.0, Linear(1.0), Linear(1.0), 1.0)
    robot = Robot("PSM1", "1", "QLA1", (actuator,) * 7)
    pid = PidConfig("PSM1", "PSM1", tuple(PidAxis(joint, "REVOLUTE", 1.0, 0.0, 0.0) for joint in (*JOINTS, "jaw")))
    tool = Tool("TEST:1", tuple(_link(j) for j in JOINTS[3:]), JawConfig(-0.5, 1.0, 0.16), IDENTITY, IDENTITY, (), ())
    io = IoConfig("IO1", "udp:127.0.0.1", "broadcast-query-read-write", 1 / 1500, 0.03, False, (robot,), (pid,), ())
    chain = Chain("modified", tuple(_link(j) for j in JOINTS[:3]))
    arm = ArmConfig("PSM1", "PSM", "Classic", "1", "IO1", "PSM1", "NONE", 1 / 1500, chain, tool=tool)
    processes = (Process("IO1", "io", 1 / 1500), Process("PSM1", "arm", 1 / 1500, ("IO1",)))
    recorder = None if recordings is None else Recorder(str(recordings))
    processes += (Process("recorder", "recorder", 0.02),) if recorder is not None else ()
    return SystemConfig(name, "made by a test", "wall", (io,), (arm,), None, processes, recorder=recorder)


def short(kept: int, name: str, kind: str, schema: Schema, depth: int, info: dict[str, Any] | None = None) -> int:
    """Rings keep a few records."""
    return create(name, kind, schema, min(depth, kept) if kind == directory.RING else depth, info)


class ScriptedRobot:
    """The segments of one system, and the writing ends of its arm and io.

    With a folder for `recordings` it has the places of a recorder, too, which the test may take.
    """

    def __init__(self, name: str, recordings: Path | None = None, kept: int = KEPT) -> None:
        self.name = name
        memory.create_all(_document(name, recordings), partial(short, kept))
        self.pages = {i: ControlPage(name, i, write=True) for i in ("supervisor", "IO1", "PSM1")}
        for instance, page in self.pages.items():
            page.segment.claim(instance)
            page.field("pid")[...] = os.getpid()
            page.show("RUNNING")
        self.arm = directory.writer(name, "PSM1", "state", "arm")
        self.io = directory.writer(name, "IO1", "state", "io")
        self.supervisor = directory.writer(name, "supervisor", "state", "supervisor")
        self.events = Events(directory.writer(name, "PSM1", "events", "arm"), monotonic_ns)
        self.mailbox = Mailbox(name, "PSM1", COMMANDS["arm"])
        self.beat()
        self._ledger()

    def beat(self) -> None:
        """Every process shows that it lives; the supervisor, which beats without us, for the whole test."""
        for name, page in self.pages.items():
            page.field("heartbeat_ns")[...] = monotonic_ns() + 60_000_000_000 * (name == "supervisor")

    def _ledger(self) -> None:
        for i, (instance, kind) in enumerate((("IO1", b"io"), ("PSM1", b"arm"))):
            self.supervisor.field("instance")[i] = instance.encode()
            self.supervisor.field("kind")[i] = kind
            self.supervisor.field("lifecycle")[i] = b"RUNNING"
        self.supervisor.publish(monotonic_ns())

    def restarted(self, times: int, reason: str) -> None:
        """The supervisor notes deaths of PSM1."""
        self.supervisor.field("restarts")[1] = times
        self.supervisor.field("exit_reason")[1] = reason.encode()
        self.supervisor.publish(monotonic_ns())

    def show_arm(self, position: float = 0.1, state: str = "DISABLED", *, valid: bool = True, homed: bool = False,
                 busy: bool = False, jaw: bool = True, age_s: float = 0.0, stamp_ns: int = 0) -> None:
        """One record of the arm, so old or with that stamp, every joint at `position`."""
        values = {"valid": valid, "cartesian_valid": valid, "reference_valid": valid, "count": 6,
                  "state": state.encode(), "is_homed": homed,
                  "sub_state": b"HOMED" if homed and state == "ENABLED" else state.encode(),
                  "is_busy": busy, "has_jaw": jaw,
                  "jaw_position": position, "jacobian": np.ones((6, 8))}
        for field, value in values.items():
            self.arm.field(field)[...] = value
        self.arm.field("names")[:6] = [joint.encode() for joint in JOINTS]
        self.arm.field("position")[:6] = position
        self.arm.field("velocity")[:6] = np.nan
        self.arm.field("spatial_jacobian")[...] = self.arm.field("body_measured_cf")[...] = np.nan
        self.arm.field("measured_cp")[...] = (1, 2, 3, 0, 0, 0, 1)
        self.arm.publish(stamp_ns or monotonic_ns() - round(age_s * 1e9))

    def close_ends(self) -> None:
        """Give everything back; the segments stay, as of a system that died."""
        for page in self.pages.values():
            page.close()
        for end in (self.arm, self.io, self.supervisor, self.mailbox):
            end.close()

    def close(self) -> None:
        """Give everything back and remove the segments."""
        self.close_ends()
        remove_all(self.name)


def nothing_ages(monkeypatch: pytest.MonkeyPatch) -> None:
    """Time stands for whoever asks how old a record is, however slow this machine is."""
    now_ns = monotonic_ns()
    monkeypatch.setattr("trocar.tools.inspect.watch.monotonic_ns", lambda: now_ns)
    monkeypatch.setattr("trocar.tools.client.shared.SystemTime",
                        lambda _: SimpleNamespace(now_ns=lambda: now_ns, close=lambda: None))


@contextlib.contextmanager
def robot(name: str, kept: int = KEPT) -> Iterator[ScriptedRobot]:
    """A system that is gone afterwards, whatever happens."""
    made = ScriptedRobot(name, kept=kept)
    try:
        yield made
    finally:
        made.close()


__all__ = ["JOINTS", "KEPT", "ScriptedRobot", "nothing_ages", "robot", "short"]
