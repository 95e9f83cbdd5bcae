"""Blocks on a table that instruments push about: a small MuJoCo scene beside the arms.

Instruments are where they were measured, and no block holds them up; blocks have weight, friction and contact. From the
same place the same motion gives the same, to the last bit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from trocar.procs.rl.scene import BOX, Colour, Drawn

Array = NDArray[np.float64]

STEP_S: Final = 0.001
STIFF_S: Final = 0.004
"""Time constant of contacts: a block that is pushed at 40 mm/s gives way by 0.3 mm."""
HARD_S: Final = 0.002
"""The same of the table: jaws that press a block down, with any force, do not press it into the table."""
SETTLE_S: Final = 0.05
"""Until blocks that were put down lie still."""
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
        """Put the blocks down on the table: x, y, turn about the vertical (blocks, 3); instruments are at `parts`."""
        data = self._data
        mujoco.mj_resetData(self._model, data)
        for number, (block, (x, y, turn)) in enumerate(zip(self._blocks, places, strict=True)):
            data.qpos[7 * number : 7 * number + 7] = (
                x, y, self._table_m + block.half_m[2], np.cos(0.5 * turn), 0.0, 0.0, np.sin(0.5 * turn))
        self._take(parts)
        self._from_place[...], self._from_turn[...] = self._to_place, self._to_turn
        self._run(SETTLE_S)

    def follow(self, parts: Sequence[Drawn], seconds: float) -> None:
        """Instruments have moved to `parts` within so many seconds."""
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
