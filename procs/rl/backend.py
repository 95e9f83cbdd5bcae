"""What plays the robot of an environment: a host in this process, or a running system."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, Protocol

from trocar.procs.kinematics.poses import Array
from trocar.procs.rl.link import ArmLink
from trocar.procs.rl.model import ArmModel, StartPose

KINEMATIC, BOARDS, ATTACHED = "kinematic", "boards", "attached"
BACKENDS: Final = (KINEMATIC, BOARDS, ATTACHED)


class RobotStopped(RuntimeError):
    """The robot of an environment stands, and a person has to look at it: nothing here switches it on again.

    A fault, a hold-up or a refused move has ended what the environment may do; the text says which. Once the robot is
    as it should be (`trocar status`, `trocar home`), make a new environment: that is the command to go on.
    """


class WrongAction(ValueError):
    """What was given as an action is none of this environment."""


class RobotBackend(Protocol):
    """The arms of one environment, in its order. Methods with a body here do nothing where nobody else has the arms."""

    models: Sequence[ArmModel]
    links: Sequence[ArmLink]
    frame: str
    """In which poses are told."""

    def now_ns(self) -> int:
        """The system's time."""

    def look(self, number: int) -> str:
        """Take the newest record of an arm; why it cannot be commanded, empty: it can."""

    def begin(self, number: int, starts: Sequence[StartPose], seed: int) -> None:
        """An episode begins: bring all arms to their starts, number `number` of them. RobotStopped says why not.

        `seed`: of the noise of emulated sensors.
        """

    def heads_for(self, number: int, joints: Array, jaw: float) -> None:
        """An arm is going to be brought to joints (count,) and a jaw: where else its setpoint goes is not our doing."""
        return

    def wait_until(self, deadline_ns: int) -> None:
        """Let the system's time come; RobotStopped where it came so late that nothing may go on."""

    def keeps_pace(self, period_ns: int) -> None:
        """Setpoints are sent now, the next ones a period later; RobotStopped where nothing may be sent."""
        return

    def check(self) -> None:
        """RobotStopped where nothing more is asked of it; see `stop`."""
        return

    def stop(self, why: str) -> None:
        """The episode has failed: where a person has to look at the robot, nothing more is asked of it."""
        return

    def close(self) -> None:
        """The end of it; harmless when it is closed."""
