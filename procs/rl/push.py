"""Push a block on a table to a place, with closed jaws: a task with contact, friction and weight."""

from __future__ import annotations

import math
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.rl.objects import Objects, PushedBlock
from trocar.procs.rl.scene import GREEN, Drawn, ball, touching
from trocar.procs.rl.tasks import PsmReach

Array = NDArray[np.float64]

BLOCK: Final = PushedBlock((0.006, 0.006, 0.005), 0.004, (0.93, 0.62, 0.12, 1.0))
NEAR_M: Final = 0.012
"""The block begins so near to below the middle."""
PUSH_M: Final = (0.010, 0.022)
"""So far it is to be pushed."""


class PsmPush(PsmReach):
    """Push a block over the table to a place. Goals are places (3,) of its middle, in m."""

    FLOOR_M: ClassVar[float] = 0.035
    EXTRA: ClassVar[tuple[str, ...]] = (*(f"block {axis} [m]" for axis in "xyz"),
                                        *(f"block's own x axis, {axis}" for axis in "xyz"))

    def __init__(self, **options: Any) -> None:
        """See RobotEnv."""
        super().__init__(**options)
        model = self.robot.models[0]
        self._table_m = float(model.middle[2]) - self.FLOOR_M
        self.objects = Objects(touching(model, model.centre, model.jaw), (BLOCK,), self._table_m)
        self._seen_block = np.zeros(3)

    def begin_task(self, random: np.random.Generator) -> None:
        middle = self.robot.models[0].middle[:2]
        at = middle + random.uniform(-NEAR_M, NEAR_M, 2)
        way, far = random.uniform(0.0, math.tau), random.uniform(*PUSH_M)
        goal = at + far * np.array((math.cos(way), math.sin(way)))
        self.goal = np.append(goal, self._table_m + BLOCK.half_m[2])
        self.objects.place(np.array([[*at, random.uniform(0.0, math.tau)]]), self._parts_now())
        self._see()

    def go_on(self) -> None:
        self.objects.follow(self._parts_now(), self.period_s)
        self._see()

    def _parts_now(self) -> list[Drawn]:
        return touching(self.robot.models[0], *self.seen_joints(0))

    def _see(self) -> None:
        self._seen_block = self.truly_achieved()
        if self.noise_m:
            self._seen_block += self.np_random.normal(0.0, self.noise_m, 3)

    def achieved(self) -> Array:
        return self._seen_block.copy()

    def truly_achieved(self) -> Array:
        return self.objects.pose(0)[:3, 3].copy()

    def extra(self) -> Array:
        return np.concatenate((self._seen_block, self.objects.pose(0)[:3, 0]))

    def things(self) -> list[Drawn]:
        return [ball(self.goal, self.tolerance_m, GREEN), *self.objects.drawn()]
