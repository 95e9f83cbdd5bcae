"""Cartesian impedance: a wrench that grows with the distance from a place and an orientation, and with speed.

Per axis and per sign of the error there is a set of gains: stiffness P, damping D, bias b and a dead-band that the
error is shrunk by: f = P · e + D · v + b. Gains have their sign: a negative P pulls back. Forces are worked out in
axes that are given with the place, torques in those of the orientation.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.kinematics.poses import PoseError, given_rotation, rotation_vector

Array = NDArray[np.float64]

KINDS: Final = 4  # P, D, bias, dead-band
COUNT: Final = 3 + 4 + 4 + 2 * KINDS * 6
"""Numbers of a servo_ci command, see `impedance_of`."""


class ImpedanceGains:
    """One set of gains; all poses, twists and wrenches are those of the reference frame."""

    def __init__(self, place: Array, force_axes: Array, orientation: Array, gains: Array) -> None:
        """`place` (3,) for forces, their axes (3, 3); `orientation` (3, 3) for torques, in its own axes.

        Gains (2, 4, 6): for positive and negative errors; P, D, bias, dead-band; x y z rx ry rz.
        """
        self._place, self._force_axes, self._orientation = place, force_axes, orientation
        self.gains = gains
        self._error, self._speed, self._wrench = np.zeros(6), np.zeros(6), np.zeros(6)

    def wrench(self, pose: Array, twist: Array) -> Array:
        """Force and torque (6,) for a measured pose (4, 4) and twist (6,); the next call overwrites it."""
        error, speed, forces, torques = self._error, self._speed, self._force_axes, self._orientation
        error[:3] = (pose[:3, 3] - self._place) @ forces  # rows: xᵀ · R = (Rᵀ · x)ᵀ
        error[3:] = rotation_vector(torques.T @ pose[:3, :3])
        speed[:3], speed[3:] = twist[:3] @ forces, twist[3:] @ torques
        p, d, bias, deadband = np.where(error > 0.0, self.gains[0], self.gains[1])
        shrunk = np.sign(error) * np.maximum(np.abs(error) - np.abs(deadband), 0.0)
        force = p * shrunk + d * speed + bias
        self._wrench[:3], self._wrench[3:] = forces @ force[:3], torques @ force[3:]
        return self._wrench


def impedance_of(values: Array) -> ImpedanceGains:
    """From the numbers of a command; PoseError where they are too few or a quaternion is none.

    Place (3), quaternion of the forces' axes (4), orientation (4), then for positive errors P x y z rx ry rz, D, bias,
    dead-band in that order, then the same for negative errors.
    """
    if len(values) != COUNT:
        raise PoseError(f"servo_ci takes {COUNT} values, {len(values)} were given")
    return ImpedanceGains(values[:3].copy(), given_rotation(values[3:7]), given_rotation(values[7:11]),
                          values[11:].reshape(2, KINDS, 6).copy())
