"""Two PSMs of one system: the first holds a peg, the second takes it over and brings it to a goal position.

Rules, not physics, decide which jaws hold the peg: jaws that close around it hold it, it moves with its first holder,
and without a holder it is on the table at once.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, ClassVar, Final

import numpy as np

from trocar.procs.kinematics.poses import Array, inverse, matrix_from_pose
from trocar.procs.rl.backend import BOARDS, KINEMATIC
from trocar.procs.rl.environment import RobotEnv
from trocar.procs.rl.scene import GREEN, Drawn, ball, rod
from trocar.procs.rl.tasks import in_ball

FIRST, SECOND = 0, 1
OPEN_RAD, CLOSED_RAD = 0.35, 0.15
"""Jaws wider than the first have released the peg, jaws narrower than the second hold it."""
BETWEEN_M: Final = 0.006
"""From a tip, which is the hinge of its jaws, to the held object."""
CLOSE_M: Final = 0.006
"""Maximum distance of the peg's middle from there when jaws take it."""
HAND_M: Final = 0.1
"""Distance between a goal with the peg in the second arm's jaws alone and one without."""
NEAR_M: Final = 0.025
PEG_M: Final = (0.0022, 0.009)
"""Radius and half length."""
PEG_COLOUR: Final = (0.93, 0.62, 0.12, 1.0)


class Peg:
    """Its pose (4, 4), and the arms that hold it, in the order in which they took it."""

    def __init__(self, arms: int, table_m: float) -> None:
        """`table_m`: height of the table."""
        self.pose, self.holders, self._table_m = np.eye(4), list[int](), table_m
        self._held_at = np.eye(4)  # in the grip of the first holder
        self._was_open = [False] * arms

    def give(self, arm: int, grips: list[Array], jaws: list[float]) -> None:
        """An episode begins: the peg is across the jaws of this arm."""
        self.holders, self._was_open = [arm], [jaw > OPEN_RAD for jaw in jaws]
        self._held_at = np.eye(4)
        self._held_at[:3, :3] = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
        self.pose = grips[arm] @ self._held_at

    def follow(self, grips: list[Array], jaws: list[float]) -> None:
        """Arms have moved: the frames (4, 4) between their jaws, and the angles of these."""
        if self.holders:
            self.pose = grips[self.holders[0]] @ self._held_at
        first = self.holders[:1]
        for arm, (grip, jaw) in enumerate(zip(grips, jaws, strict=True)):
            if jaw > OPEN_RAD:
                self._was_open[arm] = True
                self.holders = [holder for holder in self.holders if holder != arm]
            elif jaw < CLOSED_RAD and self._was_open[arm]:
                self._was_open[arm] = False
                if math.dist(grip[:3, 3], self.pose[:3, 3]) <= CLOSE_M:
                    self.holders.append(arm)
        if not self.holders:
            self.pose[2, 3] = self._table_m + PEG_M[0]
        elif self.holders[:1] != first:
            self._held_at = inverse(grips[self.holders[0]]) @ self.pose


class PsmHandOver(RobotEnv):
    """Hand a peg from the first PSM to the second, which brings it to a goal position.

    Goals (4,): the position of the peg, m, then 1 if the second arm alone holds it, else 0.
    """

    FILES: ClassVar[Mapping[str, str]] = {KINEMATIC: "kinematic-hand-over.yaml", BOARDS: "demo-hand-over.yaml"}
    ARMS: ClassVar[tuple[str, ...]] = ("PSM1", "PSM2")
    JAWS: ClassVar[tuple[float, ...]] = (0.0, 0.7)
    GOAL: ClassVar[int] = 4
    EXTRA: ClassVar[tuple[str, ...]] = (*(f"peg {axis} [m]" for axis in "xyz"),
                                        *(f"held by the {which} arm" for which in ("first", "second")))

    def __init__(self, **options: Any) -> None:
        self._seen_peg = np.zeros(3)
        super().__init__(**options)
        table_m = float(np.mean([model.middle[2] for model in self.robot.models])) - self.FLOOR_M
        self.peg = Peg(len(self.ARMS), table_m)

    def grips(self) -> tuple[list[Array], list[float]]:
        """Frames (4, 4) between the jaws of the arms, and the angles of these."""
        grips = [matrix_from_pose(self.seen_pose(arm)) for arm in (FIRST, SECOND)]
        for grip in grips:
            grip[:3, 3] += BETWEEN_M * grip[:3, 2]
        return grips, [self.seen_joints(arm)[1] for arm in (FIRST, SECOND)]

    def begin_task(self, random: np.random.Generator) -> None:
        self.goal = np.append(self.robot.models[SECOND].middle + in_ball(random, NEAR_M), 1.0)
        self.peg.give(FIRST, *self.grips())
        self._see()

    def go_on(self) -> None:
        self.peg.follow(*self.grips())
        self._see()

    def _see(self) -> None:
        self._seen_peg = self.peg.pose[:3, 3].copy()
        if self.noise_m:
            self._seen_peg += self.np_random.normal(0.0, self.noise_m, 3)

    def achieved(self) -> Array:
        return np.append(self._seen_peg, float(self.peg.holders == [SECOND]))

    def truly_achieved(self) -> Array:
        return np.append(self.peg.pose[:3, 3], float(self.peg.holders == [SECOND]))

    def extra(self) -> Array:
        return np.array((*self._seen_peg, *(float(arm in self.peg.holders) for arm in (FIRST, SECOND))))

    def distance(self, achieved_goal: Array, desired_goal: Array) -> Array:
        """Between positions, plus HAND_M if only one of them has the peg in the second arm's jaws."""
        difference = np.asarray(achieved_goal) - np.asarray(desired_goal)
        return np.asarray(np.linalg.norm(difference[..., :3], axis=-1) + HAND_M * np.abs(difference[..., 3]))

    def things(self) -> list[Drawn]:
        middle, along = self.peg.pose[:3, 3], self.peg.pose[:3, 2] * PEG_M[1]
        return [ball(self.goal[:3], self.tolerance_m, GREEN), rod(middle - along, middle + along, PEG_M[0], PEG_COLOUR)]
