"""Tasks of one arm: a PSM's tip reaches a goal, or follows a moving one; an endoscope looks at a target."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import ClassVar, Final

import numpy as np

from trocar.procs.kinematics.poses import Array, matrix_from_pose
from trocar.procs.rl.backend import BOARDS, KINEMATIC
from trocar.procs.rl.environment import RobotEnv
from trocar.procs.rl.model import SPREAD
from trocar.procs.rl.scene import GREEN, Drawn, ball, rod

NEAR_M: Final = 0.035
"""Maximum distance of goals from the tip at the centre of the starts."""
TRACK_MIDDLE_M, TRACK_SIZE_M = 0.015, (0.008, 0.015)
TRACK_HZ: Final = (0.1, 0.2)
SIGHT_COLOUR: Final = (0.95, 0.75, 0.10, 1.0)
SIGHT_M: Final = 0.10
"""From the tip of an endoscope to its target."""


def in_ball(random: np.random.Generator, radius: float) -> Array:
    """A point (3,) anywhere in a ball about 0, each place as likely."""
    direction = random.normal(size=3)
    return np.asarray(direction / np.linalg.norm(direction) * (radius * float(random.random()) ** (1.0 / 3.0)))


class PsmReach(RobotEnv):
    """Bring the tip of a PSM to a position. Goals are positions (3,) of the tip, in m."""

    FILES: ClassVar[Mapping[str, str]] = {KINEMATIC: "kinematic.yaml", BOARDS: "demo.yaml"}
    ARMS: ClassVar[tuple[str, ...]] = ("PSM1",)
    JAWS: ClassVar[tuple[float, ...]] = (0.0,)

    def begin_task(self, random: np.random.Generator) -> None:
        self.goal = self.robot.models[0].middle + in_ball(random, NEAR_M)

    def things(self) -> list[Drawn]:
        return [ball(self.goal, self.tolerance_m, GREEN)]


class PsmTrack(PsmReach):
    """Follow a target on a smooth closed path with the tip of a PSM. Goals as in PsmReach; they cannot be given."""

    IS_GIVEN: ClassVar[bool] = False
    EXTRA: ClassVar[tuple[str, ...]] = tuple(f"goal velocity {axis} [m/s]" for axis in "xyz")

    def begin_task(self, random: np.random.Generator) -> None:
        self._middle = self.robot.models[0].middle + in_ball(random, TRACK_MIDDLE_M)
        self._amplitude = random.uniform(*TRACK_SIZE_M, 3)
        self._turns = math.tau * random.uniform(*TRACK_HZ, 3)
        self._phase = random.uniform(0.0, math.tau, 3)
        self.go_on()

    def go_on(self) -> None:
        self.goal = self._middle + self._amplitude * np.sin(self._turns * self.steps * self.period_s + self._phase)

    def extra(self) -> Array:
        angles = self._turns * self.steps * self.period_s + self._phase
        return np.asarray(self._amplitude * self._turns * np.cos(angles))


class EcmAim(RobotEnv):
    """Look at a target with an ECM. Goals are positions (3,), in m, on the line of sight, 0.1 m before the tip."""

    FILES: ClassVar[Mapping[str, str]] = {KINEMATIC: "kinematic-ecm.yaml", BOARDS: "demo-ecm.yaml"}
    TYPE: ClassVar[str] = "ECM"
    ARMS: ClassVar[tuple[str, ...]] = ("ECM",)
    FLOOR_M: ClassVar[float] = 0.16
    JAWS: ClassVar[tuple[float, ...]] = (0.0,)

    def begin_task(self, random: np.random.Generator) -> None:
        model, spread = self.robot.models[0], np.full(self.robot.models[0].count, SPREAD[-1])
        spread[: len(SPREAD) - 1] = SPREAD[:-1]
        tip = model.tip(model.centre + random.uniform(-1.0, 1.0, model.count) * spread)
        self.goal = tip[:3, 3] + SIGHT_M * tip[:3, 2]

    def _line_of_sight(self) -> Array:
        return matrix_from_pose(self.seen_pose(0))[:3, 2]

    def achieved(self) -> Array:
        return np.asarray(self.tips[0] + SIGHT_M * self._line_of_sight())

    def truly_achieved(self) -> Array:
        return np.asarray(self.seen_pose(0)[:3] + SIGHT_M * self._line_of_sight())

    def things(self) -> list[Drawn]:
        seen = self.truly_achieved()
        return [ball(self.goal, self.tolerance_m, GREEN), rod(self.seen_pose(0)[:3], seen, 0.001, SIGHT_COLOUR),
                ball(seen, 0.002, SIGHT_COLOUR)]
