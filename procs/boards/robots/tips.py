"""Where the tips of the robots are, how they move, and what pulls at them."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from trocar.procs.boards.robots.assembly import Assembly
from trocar.procs.boards.robots.mechanics import Mechanism

Array = NDArray[np.float64]


class Tips:
    """The tips of all robots of a model; everything in a robot's own base frame."""

    def __init__(self, assembly: Assembly, data: mujoco.MjData, mechanisms: tuple[Mechanism, ...]) -> None:
        """`moved` has to be called whenever joints have moved."""
        self._model, self._data = assembly.model, data
        self._bodies: dict[str, int] = {}
        self._bases: dict[str, Array] = {}
        self._places: dict[str, Array] = {}
        for one in mechanisms:
            self._bodies[one.robot] = int(assembly.model.body(f"{one.robot}/{one.tip_axis}").id) if one.axes else 0
            self._bases[one.robot] = one.base
            self._places[one.robot] = one.axes[one.tip_axis].after @ one.tip if one.axes else one.base
        self._linear, self._angular = np.zeros((3, assembly.model.nv)), np.zeros((3, assembly.model.nv))
        self._is_stale = True

    def moved(self) -> None:
        """Bodies' poses have to be computed anew when next asked for."""
        self._is_stale = True

    def pose(self, robot: str) -> Array:
        """(4, 4)."""
        pose: Array = np.linalg.inv(self._bases[robot]) @ self._world(robot)
        return pose

    def twist(self, robot: str) -> Array:
        """(6,), linear then angular: of the tip itself, in the axes of the base."""
        point = self._world(robot)[:3, 3]
        mujoco.mj_jac(self._model, self._data, self._linear, self._angular, point, self._bodies[robot])
        turn = self._bases[robot][:3, :3].T
        return np.concatenate((turn @ (self._linear @ self._data.qvel), turn @ (self._angular @ self._data.qvel)))

    def add_pull(self, robot: str, wrench: Array, efforts: Array) -> None:
        """Add to joints' efforts (nv,) what a force and torque (6,) at the tip do."""
        point, turn = self._world(robot)[:3, 3], self._bases[robot][:3, :3]
        force, torque = turn @ wrench[:3], turn @ wrench[3:]
        mujoco.mj_applyFT(self._model, self._data, force, torque, point, self._bodies[robot], efforts)

    def _world(self, robot: str) -> Array:
        """Pose of a tip in the world."""
        if self._is_stale:
            mujoco.mj_kinematics(self._model, self._data)
            mujoco.mj_comPos(self._model, self._data)
            self._is_stale = False
        body = self._bodies[robot]
        matrix = np.eye(4)
        matrix[:3, :3] = self._data.xmat[body].reshape(3, 3)
        matrix[:3, 3] = self._data.xpos[body]
        pose: Array = matrix @ self._places[robot]
        return pose
