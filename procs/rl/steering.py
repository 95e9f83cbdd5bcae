"""From actions to goals: increments bounded by the joints' velocity limits, within position limits and workspace."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from trocar.procs.kinematics.poses import Array, pose_from_matrix, rotation_from_vector, rotation_vector
from trocar.procs.rl.model import INSERTION, ROOM_M, ArmModel

JOINT, CARTESIAN = "joint", "cartesian"
CONTROLS: Final = (JOINT, CARTESIAN)
LESS: Final = 0.98
"""Fraction of a joint's limit used where it would be exceeded: joints are not quite proportional to the tip's path."""
FASTEST_TURN: Final = 2.0 * math.pi
"""Limit for the tip in Cartesian control, rad/s at speed 1, if the last joint is that fast."""


class Steering:
    """The goal of one arm. An action (size,) changes it, each number from −1 to 1 of the allowed maximum.

    Joint control: a number for each joint. Cartesian control: the tip's translation along x y z and its rotation about
    them, in axes of the frame of its poses. Then, if there is one, the jaw.
    """

    def __init__(self, model: ArmModel, control: str, speed: float, period_s: float) -> None:
        """`speed`: share of the velocities of moves at ratio 1 that is allowed; `period_s`: of an action."""
        self.model, self.control = model, control
        self._most = model.v_max[: model.count] * speed * period_s
        self._most_jaw = float(model.v_max[-1]) * speed * period_s if model.has_jaw else 0.0
        self._shift = float(self._most[INSERTION])
        self._turn = min(float(model.v_max[model.count - 1]), FASTEST_TURN) * speed * period_s
        self.moves = model.count if control == JOINT else 6
        self.size = self.moves + int(model.has_jaw)
        self._centre = model.local_tip(model.centre)[:3, 3].copy()
        self.joints, self.jaw = model.centre.copy(), model.jaw
        self.tip = model.local_tip(self.joints)
        """The goal of the tip (4, 4) in the arm's base."""

    def begin(self, joints: Array, jaw: float) -> None:
        """The goal is here: joints (count,), jaw in rad."""
        self.joints, self.jaw = np.array(joints), jaw
        self.tip = self.model.local_tip(self.joints)

    def pose(self) -> Array:
        """The goal of the tip (4, 4) in the frame of its poses."""
        return self.model.base @ self.tip

    def take(self, action: Array) -> None:
        """Change the goal; only the jaw's part of a change that would leave the workspace around the centre is made."""
        bounded = np.clip(action, -1.0, 1.0)
        if self.model.has_jaw:
            space = self.model.space
            self.jaw = min(max(self.jaw + float(bounded[-1]) * self._most_jaw, float(space.lower[-1])),
                           float(space.upper[-1]))
        found = self._by_joints(bounded) if self.control == JOINT else self._by_tip(bounded)
        if found is not None:
            self.joints, self.tip = found

    def _by_joints(self, action: Array) -> tuple[Array, Array] | None:
        n, space = self.model.count, self.model.space
        joints = self.joints + action[:n] * self._most
        if space.paired is not None:
            joints = (space.paired @ np.append(joints, self.jaw))[:n]
        np.clip(joints, space.lower[:n], space.upper[:n], out=joints)
        return self._kept(joints)

    def _by_tip(self, action: Array) -> tuple[Array, Array] | None:
        """Apply as much as limits and velocities allow: less in the same direction, else as close as possible."""
        if not action[:6].any():
            return None
        solver, goal = self.model.inverse, self._shifted(action, 1.0)
        if solver.solve(goal, self.joints):
            excess = float((np.abs(solver.q - self.joints) / self._most).max())
            if excess <= 1.0 or self._fits(self._shifted(action, LESS / excess)):
                return self._kept(solver.q.copy())
        solver.approach(goal, self.joints, self._most)
        return self._kept(solver.q.copy())

    def _shifted(self, action: Array, share: float) -> Array:
        """The goal of the tip after a share of an action."""
        axes, goal = self.model.base[:3, :3].T, self.tip.copy()
        goal[:3, 3] += axes @ (action[:3] * (self._shift * share))
        goal[:3, :3] = rotation_from_vector(axes @ (action[3:6] * (self._turn * share))) @ goal[:3, :3]
        return goal

    def _fits(self, goal: Array) -> bool:
        """Whether there are joints for it that can be had in the time."""
        solver = self.model.inverse
        return solver.solve(goal, self.joints) and bool((np.abs(solver.q - self.joints) <= self._most).all())

    def _kept(self, joints: Array) -> tuple[Array, Array] | None:
        """These and their tip, unless that would leave its room; back into it is always allowed."""
        tip = self.model.local_tip(joints)
        away, before = tip[:3, 3] - self._centre, self.tip[:3, 3] - self._centre
        distance = math.sqrt(float(away @ away))
        return (joints, tip) if distance <= ROOM_M or distance < math.sqrt(float(before @ before)) else None


class Interpolator:
    """One arm: straight lines from goal to goal, of joints or of the tip, which turns about one axis; and of the jaw.

    Each setpoint is a command and its values: servo_jp (count,) or servo_cp (7,), and jaw/servo_jp (1,).
    """

    def __init__(self, steering: Steering, parts: int) -> None:
        """`parts`: this many setpoints for each goal, the last of them the goal itself."""
        self._steering, self._parts = steering, parts
        self._is_joint, self._has_jaw = steering.control == JOINT, steering.model.has_jaw
        self.begin()

    def begin(self) -> None:
        """From the present goal on."""
        self._joints, self._jaw, self._pose = self._goal()

    def _goal(self) -> tuple[Array, float, Array]:
        return self._steering.joints.copy(), self._steering.jaw, self._steering.pose()

    def setpoints(self) -> Iterator[list[tuple[str, Array]]]:
        """Setpoints up to the present goal, to be sent one after the other at equal times."""
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
