"""Numbers from scripts, in the order in which commands take them; springs and dampers of `servo_ci`, too."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trocar.procs.kinematics.poses import PoseError, check_matrix, pose_from_matrix

Array = NDArray[np.float64]
Stamped = tuple[Array, int]

FRESH_S = 1.0  # a read raises when the newest value is older


NONE = (0.0, 0.0, 0.0)
WITHOUT = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


class JointState(NamedTuple):
    """Joint positions, velocities and efforts (n,); empty if a topic lacks them."""

    position: Array
    velocity: Array
    effort: Array


def numbers(values: ArrayLike) -> Array:
    """Numbers in one row (n,), also a single one; ValueError for other types."""
    if values is None:
        raise ValueError("expected numbers, not None")
    try:
        given = np.asarray(values, dtype=np.float64)
    except TypeError as error:
        raise ValueError(f"not numbers: {error}") from None
    if given.ndim > 1:
        raise ValueError(f"expected a one-dimensional array of numbers, not shape {given.shape}")
    return given.reshape(-1)


def pose_numbers(matrix: ArrayLike) -> Array:
    """x y z, quaternion x y z w (7,) of a 4×4 matrix; PoseError, a ValueError, if it is not a rigid transform."""
    given = np.asarray(matrix, dtype=np.float64)
    check_matrix(given)
    return pose_from_matrix(given)


def rotation_numbers(rotation: ArrayLike) -> Array:
    """Quaternion x y z w (4,) of a 3×3 matrix; PoseError if it is not a rotation."""
    given = np.asarray(rotation, dtype=np.float64)
    if given.shape != (3, 3):
        raise PoseError(f"a rotation is a 3×3 matrix, not one of shape {given.shape}")
    pose = np.eye(4)
    pose[:3, :3] = given
    return pose_numbers(pose)[3:]


def six_numbers(values: ArrayLike, what: str) -> Array:
    """A twist or a wrench (6,), linear part first; ValueError when it has another size."""
    given = numbers(values)
    if given.shape != (6,):
        raise ValueError(f"{what} has 6 numbers, linear then angular, not {given.size}")
    return given


@dataclass(slots=True)
class Gains:
    """For one sign of the error, three axes (3,) each: stiffness, damping, bias, dead band (subtracted from e): p · e
    + d · v + bias.

    Gains are signed: a negative p pulls back, a negative d brakes. Forces: N/m, N·s/m, N, m; torques: N·m/rad,
    N·m·s/rad, N·m, rad.
    """

    p: ArrayLike = NONE
    d: ArrayLike = NONE
    bias: ArrayLike = NONE
    deadband: ArrayLike = NONE

    def rows(self) -> Array:
        """All of them (4, 3); ValueError if one does not have three numbers."""
        rows = [numbers(row) for row in (self.p, self.d, self.bias, self.deadband)]
        for name, row in zip(("p", "d", "bias", "deadband"), rows, strict=True):
            if row.shape != (3,):
                raise ValueError(f"{name} has 3 numbers, one for each axis, not {row.size}")
        return np.array(rows)


@dataclass(slots=True)
class Impedance:
    """Forces about a position, in axes of its own, and torques about an orientation; all in the reference frame.

    `force_position` (3,) m; `force_orientation` (3, 3): axes of the errors and gains of the place; `torque_orientation`
    (3, 3): the orientation, and axes of its errors and gains. Positive errors use one set of gains, those
    that are negative by another.
    """

    force_position: ArrayLike = NONE
    force_orientation: ArrayLike = WITHOUT
    torque_orientation: ArrayLike = WITHOUT
    position_positive: Gains = field(default_factory=Gains)
    position_negative: Gains = field(default_factory=Gains)
    orientation_positive: Gains = field(default_factory=Gains)
    orientation_negative: Gains = field(default_factory=Gains)

    def numbers(self) -> Array:
        """The numbers of the command (59,); ValueError if a part has another size, or is not a rotation."""
        place = numbers(self.force_position)
        if place.shape != (3,):
            raise ValueError(f"force_position has 3 numbers, not {place.size}")
        positive = np.hstack((self.position_positive.rows(), self.orientation_positive.rows()))
        negative = np.hstack((self.position_negative.rows(), self.orientation_negative.rows()))
        axes, orientation = rotation_numbers(self.force_orientation), rotation_numbers(self.torque_orientation)
        return np.concatenate((place, axes, orientation, positive.reshape(-1), negative.reshape(-1)))
