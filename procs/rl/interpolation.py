"""Setpoints between two goals of a policy: the same for every robot, whatever plays it."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from trocar.procs.kinematics.poses import pose_from_matrix, rotation_from_vector, rotation_vector
from trocar.procs.rl.steering import JOINT, Steering

Array = NDArray[np.float64]


class Interpolator:
    """One arm: straight lines from goal to goal, of joints or of the tip, which turns about one axis; and of the jaw.

    Each setpoint is a command and its values: servo_jp (count,) or servo_cp (7,), and jaw/servo_jp (1,).
    """

    def __init__(self, steering: Steering, parts: int) -> None:
        """`parts`: so many setpoints for each goal, the last of them the goal itself."""
        self._steering, self._parts = steering, parts
        self._is_joint, self._has_jaw = steering.control == JOINT, steering.model.has_jaw
        self.begin()

    def begin(self) -> None:
        """From the present goal on."""
        self._joints, self._jaw, self._pose = self._goal()

    def _goal(self) -> tuple[Array, float, Array]:
        return self._steering.joints.copy(), self._steering.jaw, self._steering.pose()

    def setpoints(self) -> Iterator[list[tuple[str, Array]]]:
        """Those to the present goal, to be sent one after the other at equal times."""
        joints, jaw, pose = self._goal()
        before, before_jaw, before_pose = self._joints, self._jaw, self._pose
        self._joints, self._jaw, self._pose = joints, jaw, pose
        turn = np.zeros(3) if self._is_joint else rotation_vector(before_pose[:3, :3].T @ pose[:3, :3])
        for part in range(1, self._parts + 1):
            share = part / self._parts
            commands: list[tuple[str, Array]] = []
            if self._is_joint:
                commands.append(("servo_jp", joints if part == self._parts else before + share * (joints - before)))
            else:
                commands.append(("servo_cp", _between(before_pose, pose, turn, share)))
            if self._has_jaw:
                commands.append(("jaw/servo_jp", np.array((before_jaw + share * (jaw - before_jaw),))))
            yield commands


def _between(before: Array, after: Array, turn: Array, share: float) -> Array:
    """The pose (7,) at a share of the way between two (4, 4), which differ by a turn (3,) in the first one's axes."""
    if share >= 1.0:
        return pose_from_matrix(after)
    pose = before.copy()
    pose[:3, 3] += share * (after[:3, 3] - before[:3, 3])
    pose[:3, :3] = before[:3, :3] @ rotation_from_vector(share * turn)
    return pose_from_matrix(pose)
