"""Joints for a pose near the present joints, the usual goal of a stream, in one step: native code, else Python."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np

from trocar.procs.arm.cartesian import Cartesian
from trocar.procs.kinematics.inverse.solver import CLOSE, LIMIT_ROOM, InverseSolver
from trocar.procs.kinematics.poses import POSE, QUATERNION_SLACK, Array, PoseError, given_pose
from trocar.procs.native.arm_fields import NEAR
from trocar.procs.native.library import chosen

FURTHEST_TURN: Final = 0.5 * math.pi  # rad; more at once is another way to hold the tip, or another turn of the roll


class Near:
    """Calls for one solver. `joints` (n,) are the last result, those of the solver."""

    slack, close, room, furthest_turn = QUATERNION_SLACK, CLOSE, LIMIT_ROOM, FURTHEST_TURN

    def __init__(self, inverse: InverseSolver, cartesian: Cartesian, at: Array) -> None:
        """`at` (n,) are the present joints, always the same array."""
        self.solver, self.inverse, self.to_base, self.at = inverse, inverse.address, cartesian.to_base, at
        self.n, self.joints = len(at), inverse.q
        self.pose = np.zeros(POSE)
        self._find: Callable[..., int] = chosen(NEAR, self, "by_numpy_")[0] if self.inverse else self.by_numpy_find

    def find(self, pose: Array, is_local: bool) -> bool:
        """Whether `joints` near `at` have the tip at a command's pose (7,), in the arm's base or the reference frame.

        Else the pose may be invalid, or out of reach, or its joints are further away.
        """
        self.pose[...] = pose
        return self._find(is_local) != 0

    # the reference of the native library

    def by_numpy_find(self, is_local: int) -> int:
        """See `find`."""
        try:
            goal = given_pose(self.pose)
        except PoseError:
            return 0
        if not self.solver.improve(goal if is_local else self.to_base @ goal, self.at):
            return 0
        return int(max(abs(x) for x in (self.joints - self.at).tolist()) <= self.furthest_turn)
