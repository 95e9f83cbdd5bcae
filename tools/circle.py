"""A circle of the tip as a path of joints: computed once, offline, by damped Newton steps on the position."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from procs.lib.kinematics import Kinematics
from tools.errors import Problem

Array = NDArray[np.float64]

POINTS = 360
MOVING = 3  # yaw, pitch and insertion carry the tip; the wrist stays
DAMPING = 1e-8
CLOSE_M = 1e-7
STEPS = 50


@dataclass(frozen=True, slots=True)
class Path:
    """A closed path over an angle: joints (k, n) at even steps of the angle, and their slopes per radian."""

    joints: Array
    slopes: Array

    def at(self, angle: float, rate: float) -> tuple[Array, Array]:
        """Joints (n,) at `angle` (rad) and their velocities when the angle grows by `rate` rad/s."""
        count = len(self.joints)
        place = angle / (2 * np.pi) * count
        low = int(np.floor(place))
        part = place - low
        i, j = low % count, (low + 1) % count
        q = self.joints[i] * (1 - part) + self.joints[j] * part
        v = (self.slopes[i] * (1 - part) + self.slopes[j] * part) * rate
        return q, v


def circle(kinematics: Kinematics, centre: Array, radius: float, points: int = POINTS) -> Path:
    """The tip on a circle of `radius` m about where it is at joints `centre` (n,), level in the arm's base frame."""
    q = np.array(centre, dtype=np.float64)
    kinematics.update(q)
    middle = kinematics.tip[:3, 3].copy()
    joints = np.zeros((points, len(q)))
    for k, angle in enumerate(np.linspace(0.0, 2 * np.pi, points, endpoint=False)):
        target = middle + radius * np.array((np.cos(angle), np.sin(angle), 0.0))
        q = _reached(kinematics, q, target)
        joints[k] = q
    if not ((joints >= kinematics.lower) & (joints <= kinematics.upper)).all():
        raise Problem(f"a circle of {radius * 1e3:g} mm leaves the joint limits")
    slopes = (np.roll(joints, -1, axis=0) - np.roll(joints, 1, axis=0)) * points / (4 * np.pi)
    return Path(joints, slopes)


def _reached(kinematics: Kinematics, start: Array, target: Array) -> Array:
    q = start.copy()
    for _ in range(STEPS):
        kinematics.update(q)
        error = target - kinematics.tip[:3, 3]
        if np.linalg.norm(error) < CLOSE_M:
            return q
        jacobian = kinematics.tip[:3, :3] @ kinematics.body[:3, :MOVING]
        q[:MOVING] += jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + DAMPING * np.eye(3), error)
    raise Problem(f"the tip does not reach {np.round(target, 4).tolist()}")
