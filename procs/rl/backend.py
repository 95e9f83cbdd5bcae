"""Backends for the robot of an environment: a host in this process, or a running system."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Protocol

from trocar.procs.kinematics.poses import Array
from trocar.procs.rl.link import ArmLink
from trocar.procs.rl.model import ArmModel, StartPose

KINEMATIC, BOARDS, ATTACHED = "kinematic", "boards", "attached"
BACKENDS: Final = (KINEMATIC, BOARDS, ATTACHED)


class RobotStopped(RuntimeError):
    """The robot of an environment has stopped, and an operator must check it; the environment never enables it again.

    A fault, a stall or a refused move has ended the environment's permission; the text gives the reason. Once the robot
    is in order (`trocar status`, `trocar home`), make a new environment; that counts as the command to continue.
    """


class WrongAction(ValueError):
    """The given action is not valid in this environment."""


class RobotBackend(Protocol):
    """The arms of one environment, in its order. Methods with a body suit backends that share the arms with no one."""

    models: Sequence[ArmModel]
    links: Sequence[ArmLink]
    frame: str
    """Frame of the poses."""

    def now_ns(self) -> int:
        """The system's time."""

    def look(self, number: int) -> str:
        """Take the newest record of an arm; why it cannot be commanded, empty: it can."""

    def begin(self, number: int, starts: Sequence[StartPose], seed: int) -> None:
        """Start an episode: move all arms to their start poses number `number`. RobotStopped gives the reason for a
        failure.

        `seed`: for the noise of emulated sensors.
        """

    def heads_for(self, number: int, joints: Array, jaw: float) -> None:
        """An arm will be moved to joints (count,) and a jaw: other motion of its setpoint is not ours."""
        return

    def wait_until(self, deadline_ns: int) -> None:
        """Wait for this time of the system; RobotStopped if it comes too late to continue."""

    def keeps_pace(self, period_ns: int) -> None:
        """Setpoints are sent now, the next ones a period later; RobotStopped if none may be sent."""
        return

    def check(self) -> None:
        """RobotStopped if no further commands are allowed; see `stop`."""
        return

    def stop(self, why: str) -> None:
        """The episode has failed: if a person must check the robot, it gets no further commands."""
        return

    def close(self) -> None:
        """Close it; no effect if it is closed."""
