"""What scripts give as numbers, in the order in which commands take them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trocar.procs.kinematics.poses import PoseError, check_matrix, pose_from_matrix

Array = NDArray[np.float64]
Stamped = tuple[Array, int]

FRESH_S = 1.0  # a read raises when the newest value is older


class JointState(NamedTuple):
    """Joint positions, velocities and efforts (n,); empty where a topic has none."""

    position: Array
    velocity: Array
    effort: Array


def numbers(values: ArrayLike) -> Array:
    """Numbers in one row (n,), also a single one; ValueError when they are none."""
    if values is None:
        raise ValueError("None is no number")
    try:
        given = np.asarray(values, dtype=np.float64)
    except TypeError as error:
        raise ValueError(f"these are no numbers: {error}") from None
    if given.ndim > 1:
        raise ValueError(f"numbers in one row are needed, not an array of shape {given.shape}")
    return given.reshape(-1)


def pose_numbers(matrix: ArrayLike) -> Array:
    """x y z, quaternion x y z w (7,) of a 4×4 matrix; PoseError, a ValueError, when it is no rigid transform."""
    given = np.asarray(matrix, dtype=np.float64)
    check_matrix(given)
    return pose_from_matrix(given)


def rotation_numbers(rotation: ArrayLike) -> Array:
    """Quaternion x y z w (4,) of a 3×3 matrix; PoseError when it is no rotation."""
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
