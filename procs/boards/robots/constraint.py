"""Rows J·q = c that hold exactly: links that follow others, and actuators that a brake holds.

MuJoCo moves all joints as if they were free; afterwards the motion that violates a row is removed along M⁻¹Jᵀ, as the
forces of rigid links and brakes would do. The result is exactly the motion of the system in reduced coordinates: no
springs, no drift.

Robots do not touch, so the system falls into small blocks, one a robot, that are solved side by side; and M⁻¹ is
evaluated for the k-th rows of all robots at once.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from trocar.procs.kinematics.poses import Array


@dataclass(frozen=True, slots=True)
class Block:
    """One robot's rows (rows, nv) and their values (rows,); `joints` are all of the robot's, in the model."""

    joints: NDArray[np.intp]
    rows: Array
    values: Array


class Projection:
    """Keeps the joints of a model on the rows of `blocks`, of which there is at least one."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, blocks: list[Block]) -> None:
        """Rows of a block must be independent."""
        self._model, self._data = model, data
        self._position, self._velocity = data.qpos, data.qvel
        count, most, joints = len(blocks), max(len(block.rows) for block in blocks), model.nv
        rows, values = np.zeros((count, most, joints)), np.zeros((count, most))
        unused = np.zeros((count, most, most))  # a block with fewer rows solves 1·x = 0 in the others
        self._block_of = np.zeros(joints, dtype=np.intp)
        for k, block in enumerate(blocks):
            used = len(block.rows)
            rows[k, :used], values[k, :used] = block.rows, block.values
            unused[k, range(used, most), range(used, most)] = 1.0
            self._block_of[block.joints] = k
        self._rows, self._values = rows.reshape(count * most, joints), values.reshape(-1)
        self._unused = unused.reshape(count * most, most)
        self._of_all_robots = rows.sum(axis=0)
        self._answers = np.zeros((most, joints))  # M⁻¹Jᵀ, the rows of all robots on top of each other
        self._per_period = 1.0 / model.opt.timestep
        self._shape = (count, most)

    def apply(self) -> None:
        """After a step: positions and velocities back onto the rows. M is the one that step was made with."""
        (count, most), answers = self._shape, self._answers.T
        error = self._rows.dot(self._position) - self._values
        mujoco.mj_solveM(self._model, self._data, self._answers, self._of_all_robots)
        square = self._rows.dot(answers) + self._unused
        solution = np.linalg.solve(square.reshape(count, most, most), error.reshape(count, most, 1))
        change = np.add.reduce(solution.reshape(self._shape).take(self._block_of, 0) * answers, axis=1)
        np.subtract(self._position, change, self._position)
        np.subtract(self._velocity, change * self._per_period, self._velocity)
