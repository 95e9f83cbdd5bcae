"""Push a block on a table to a goal position, with closed jaws: a task with contact, friction and weight.

Blocks and table are a small MuJoCo scene beside the arms. Instruments are at their measured positions, and no block can
stop them. The same motion from the same position gives the same result, to the last bit.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Final

import mujoco
import numpy as np

from trocar.procs.kinematics.poses import Array
from trocar.procs.rl.scene import BOX, GREEN, Colour, Drawn, ball, touching
from trocar.procs.rl.tasks import PsmReach

STEP_S: Final = 0.001
STIFF_S: Final = 0.004
"""Time constant of contacts: a block pushed at 40 mm/s yields by 0.3 mm."""
HARD_S: Final = 0.002
"""The same of the table: jaws that press a block down, with any force, do not press it into the table."""
SETTLE_S: Final = 0.05
"""Until blocks that were put down are at rest."""
FRICTION: Final = (0.6, 0.002, 0.0001)
"""Sliding, turning (m), rolling (m)."""


@dataclass(frozen=True, slots=True)
class PushedBlock:
    """One block: half its sizes (3,), m, its mass, kg, its colour."""

    half_m: tuple[float, float, float]
    mass_kg: float
    colour: Colour


class Objects:
    """Blocks, a table, and the parts of instruments that touch them."""

    def __init__(self, parts: Sequence[Drawn], blocks: Sequence[PushedBlock], table_m: float) -> None:
        """`parts`: rods, of which only the place changes from now on; `table_m`: height of the table."""
        self._blocks, self._table_m = blocks, table_m
        self._model = mujoco.MjModel.from_xml_string(_scene(parts, blocks, table_m))
        self._data = mujoco.MjData(self._model)
        self._from_place, self._to_place = np.zeros((len(parts), 3)), np.zeros((len(parts), 3))
        self._from_turn, self._to_turn = np.zeros((len(parts), 4)), np.zeros((len(parts), 4))

    def place(self, places: Array, parts: Sequence[Drawn]) -> None:
        """Put the blocks on the table: x, y, rotation about the vertical (blocks, 3); instruments are at `parts`."""
        data = self._data
        mujoco.mj_resetData(self._model, data)
        for number, (block, (x, y, turn)) in enumerate(zip(self._blocks, places, strict=True)):
            data.qpos[7 * number : 7 * number + 7] = (
                x, y, self._table_m + block.half_m[2], np.cos(0.5 * turn), 0.0, 0.0, np.sin(0.5 * turn))
        self._take(parts)
        self._from_place[...], self._from_turn[...] = self._to_place, self._to_turn
        self._run(SETTLE_S)

    def follow(self, parts: Sequence[Drawn], seconds: float) -> None:
        """Instruments have moved to `parts` within this many seconds."""
        self._from_place[...], self._from_turn[...] = self._to_place, self._to_turn
        self._take(parts)
        self._run(seconds)

    def _take(self, parts: Sequence[Drawn]) -> None:
        for number, part in enumerate(parts):
            self._to_place[number] = part.middle
            turn = self._to_turn[number]
            mujoco.mju_mat2Quat(turn, np.ascontiguousarray(part.axes).reshape(-1))
            if turn @ self._from_turn[number] < 0.0:
                turn *= -1.0

    def _run(self, seconds: float) -> None:
        """Let time pass; instruments move evenly to where they are to be."""
        data, steps = self._data, round(seconds / STEP_S)
        for step in range(1, steps + 1):
            share = step / steps
            data.mocap_pos[...] = self._from_place + share * (self._to_place - self._from_place)
            turns = self._from_turn + share * (self._to_turn - self._from_turn)
            data.mocap_quat[...] = turns / np.linalg.norm(turns, axis=1, keepdims=True)
            mujoco.mj_step(self._model, data)

    def pose(self, number: int) -> Array:
        """Pose (4, 4) of a block."""
        found = np.eye(4)
        found[:3, 3] = self._data.qpos[7 * number : 7 * number + 3]
        turn = np.empty(9)
        mujoco.mju_quat2Mat(turn, self._data.qpos[7 * number + 3 : 7 * number + 7])
        found[:3, :3] = turn.reshape(3, 3)
        return found

    def drawn(self) -> list[Drawn]:
        """The blocks, for pictures."""
        poses = [self.pose(number) for number in range(len(self._blocks))]
        return [Drawn(BOX, pose[:3, 3], pose[:3, :3], block.half_m, block.colour)
                for pose, block in zip(poses, self._blocks, strict=True)]


def _scene(parts: Sequence[Drawn], blocks: Sequence[PushedBlock], table_m: float) -> str:
    """The scene for MuJoCo: blocks first, so that they are the first in its state."""
    free = "".join(
        f'<body><freejoint/><geom type="box" size="{_numbers(block.half_m)}" mass="{block.mass_kg}"/></body>'
        for block in blocks)
    tools = "".join(
        f'<body mocap="true"><geom type="capsule" size="{_numbers(part.size[:2])}" contype="2" conaffinity="1"/></body>'
        for part in parts)
    return (f'<mujoco><option timestep="{STEP_S}" cone="elliptic" impratio="5"/>'
            f'<default><geom friction="{_numbers(FRICTION)}" solref="{STIFF_S} 1" conaffinity="3"/></default>'
            f'<worldbody><geom type="plane" size="1 1 0.1" pos="0 0 {table_m}" priority="1" solref="{HARD_S} 1"/>'
            f"{free}{tools}</worldbody></mujoco>")


def _numbers(values: Sequence[float]) -> str:
    return " ".join(repr(float(value)) for value in values)


BLOCK: Final = PushedBlock((0.006, 0.006, 0.005), 0.004, (0.93, 0.62, 0.12, 1.0))
NEAR_M: Final = 0.012
"""Maximum start distance of the block from the point below the middle."""
PUSH_M: Final = (0.010, 0.022)
"""Distance to push it."""


class PsmPush(PsmReach):
    """Push a block over the table to a position. Goals are positions (3,) of its centre, in m."""

    FLOOR_M: ClassVar[float] = 0.035
    EXTRA: ClassVar[tuple[str, ...]] = (*(f"block {axis} [m]" for axis in "xyz"),
                                        *(f"block's own x axis, {axis}" for axis in "xyz"))

    def __init__(self, **options: Any) -> None:
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
