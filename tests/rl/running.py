"""A running system that a host plays, the people at it, and what is made of an environment attached to it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, ClassVar

import numpy as np
import pytest

from trocar.procs.host.host import Host
from trocar.procs.rl.attached import RunningSystem
from trocar.procs.rl.backend import RobotStopped
from trocar.procs.rl.environment import RobotEnv
from trocar.procs.rl.tasks import PsmReach
from trocar.shm.mailbox.client import Client
from trocar.shm.time.system_time import PACED


class HostTime:
    """The time of a system, which passes when somebody waits for it."""

    host: ClassVar[Host]
    clock: ClassVar[str] = PACED
    simulated = True
    ahead_ns = 0
    """The clock shows so much more than the records."""
    waits = 0
    """So many until something comes, which is what `comes` does."""
    comes: ClassVar[Callable[[], object]]

    stands_after = -1
    """So many waits until it stands still."""
    hold_ups = 0
    """The wait after so many takes a quarter of a second longer."""

    def __init__(self, system: str) -> None:
        assert system == self.host.name

    def now_ns(self) -> int:
        return self.host.now_ns + self.ahead_ns

    def pause_until(self, deadline_ns: int, real_s: float) -> None:
        self.pause((deadline_ns - self.now_ns()) * 1e-9, real_s)

    def pause(self, seconds: float, real_s: float) -> None:
        self.waits -= 1
        if self.waits == 0:
            HostTime.comes()
        self.stands_after -= self.stands_after > 0
        if self.stands_after == 0:
            return  # after so much real time
        self.hold_ups -= 1
        seconds += 0.25 if self.hold_ups == 0 else 0.0
        self.host.run_until(self.host.now_ns + round(max(seconds, 0.0) * 1e9))

    def __enter__(self) -> HostTime:
        return self

    def __exit__(self, *exception: object) -> None:
        pass


def ask(host: Host, client: Client, command: str, values: Any = (), text: str = "") -> str:
    """A person asks for something; its outcome."""
    number = client.send(command, values, text)
    for _ in range(1000):
        host.run(0.02)
        for reply in client.poll():
            if reply.id == number and reply.outcome != "accepted":
                return reply.outcome
    raise AssertionError(f"{command} has no end")


def home(host: Host, *arms: str) -> None:
    for arm in arms:
        for word in ("enable", "home"):
            assert ask(host, host.client(arm), "state_command", (), word) == "done"


def made(host: Host, task: type[RobotEnv] = PsmReach, **options: Any) -> RobotEnv:
    return task(backend=RunningSystem(host.name), starts=2, **options)


def is_over(env: RobotEnv, why: str) -> None:
    """The episode has ended because of this, and nothing goes on with this environment."""
    _, _, terminated, _, info = env.step(np.zeros(env.action_space.shape))
    assert terminated and why in info["fault"] and not info["is_success"], info
    for call in (lambda: env.step(np.zeros(env.action_space.shape)), env.reset):
        with pytest.raises(RobotStopped, match="make a new environment"):
            call()


class HandAtArm:
    """A person at the arm, who presses its clutch, and pushes it."""

    def __init__(self, host: Host) -> None:
        self._host, self._boards, self._state = host, host.client("boards"), host.reader("PSM1")

    def clutch(self, on: bool) -> None:
        self._boards.send("press", (float(on),), "PSM1_arm_clutch")

    def moves(self) -> None:
        """From when the clutch is pressed to when it is released and the arm holds."""
        self.clutch(True)
        self._host.run(0.22)
        self._boards.send("apply_effort", (1.0, *(0.0,) * 6), "PSM1")
        self._host.run(0.1)
        self._boards.send("apply_effort", (0.0,) * 7, "PSM1")
        self.clutch(False)
        self._host.run(0.3)
        assert self._state.newest() and self._state.field("sub_state")[()] == b"HOMED"

    def setpoint(self) -> float:
        """Of yaw."""
        assert self._state.newest()
        return float(self._state.field("setpoint_position")[0])
