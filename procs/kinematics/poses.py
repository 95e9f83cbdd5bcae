"""Rigid poses as 7-vectors (x y z qx qy qz qw), 4×4 matrices and rotation vectors; metres and radians.

One pose is too little work for numpy's per-call cost, so the arithmetic is scalar; matrices are (4, 4) float64.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

POSE = 7  # numbers of a pose vector
QUATERNION_TOLERANCE = 1e-3  # permitted deviation of a quaternion from length 1, for rounding
QUATERNION_SLACK: Final = 0.1  # the same for commands: people and programs write few digits
ROTATION_TOLERANCE = 1e-6  # permitted deviation of R·Rᵀ from identity


class PoseError(ValueError):
    """Not a valid pose: wrong size, not finite, or not a rotation."""


def unit_quaternion(quaternion: Array) -> tuple[float, float, float, float]:
    """The quaternion (4,) x y z w, scaled to length 1; PoseError if it is not finite or its length is not nearly 1.

    An empty message has the quaternion 0 0 0 0; scaling that would give NaN or an arbitrary rotation.
    """
    if len(quaternion) != 4:
        raise PoseError(f"a quaternion has 4 numbers, not {len(quaternion)}")
    x, y, z, w = np.asarray(quaternion, dtype=np.float64).tolist()
    return _unit(x, y, z, w, QUATERNION_TOLERANCE)


def _unit(x: float, y: float, z: float, w: float, tolerance: float) -> tuple[float, float, float, float]:
    length = math.sqrt(x * x + y * y + z * z + w * w)
    if not abs(length - 1.0) <= tolerance:
        raise PoseError(f"quaternion has length {length:.6g}, must be 1 within {tolerance:g}")
    return x / length, y / length, z / length, w / length


def normalised(pose: Array) -> Array:
    """A copy of the pose (7,), with its quaternion scaled to length 1; PoseError if the pose is invalid."""
    if len(pose) != POSE:
        raise PoseError(f"a pose has {POSE} numbers, not {len(pose)}")
    result = np.array(pose, dtype=np.float64)
    if not np.isfinite(result).all():
        raise PoseError("a pose must be finite")
    result[3:] = unit_quaternion(result[3:])
    return result


def given_rotation(quaternion: Array) -> Array:
    """The rotation (3, 3) of a command's quaternion x y z w, which may have few digits; PoseError if it is invalid."""
    return given_pose(np.concatenate((np.zeros(3), quaternion)))[:3, :3].copy()


def given_pose(pose: Array) -> Array:
    """The 4×4 matrix of a command's pose (7,); PoseError if its quaternion is invalid."""
    px, py, pz, x, y, z, w = pose.tolist()
    return _matrix(px, py, pz, *_unit(x, y, z, w, QUATERNION_SLACK))


def matrix_from_pose(pose: Array) -> Array:
    """The 4×4 matrix of a pose whose quaternion has length 1 (see `normalised`)."""
    return _matrix(*pose.tolist())


def _matrix(px: float, py: float, pz: float, x: float, y: float, z: float, w: float) -> Array:
    x2, y2, z2 = x + x, y + y, z + z
    xx, yy, zz, xy, xz, yz = x * x2, y * y2, z * z2, x * y2, x * z2, y * z2
    wx, wy, wz = w * x2, w * y2, w * z2
    return np.array((1.0 - yy - zz, xy - wz, xz + wy, px, xy + wz, 1.0 - xx - zz, yz - wx, py,
                     xz - wy, yz + wx, 1.0 - xx - yy, pz, 0.0, 0.0, 0.0, 1.0)).reshape(4, 4)


def pose_from_matrix(matrix: Array, out: Array | None = None) -> Array:
    """The pose (7,) of a 4×4 matrix; the quaternion has length 1 and qw >= 0."""
    (a, b, c, px), (d, e, f, py), (g, h, i, pz) = matrix[:3].tolist()
    x, y, z, w = quaternion_of(a, b, c, d, e, f, g, h, i)
    pose = np.empty(POSE) if out is None else out
    pose[...] = (px, py, pz, x, y, z, w)
    return pose


def renormalised(matrix: Array) -> Array:
    """The 4×4 matrix with its rotation converted to a unit quaternion and back, as when dVRK loads a tip transform.

    This is not the nearest rotation: with rounded entries such as 0.7071 the result differs, and files are written for
    this method.
    """
    return matrix_from_pose(pose_from_matrix(np.asarray(matrix, dtype=np.float64)))


def product(first: Sequence[float], second: Sequence[float]) -> tuple[float, float, float, float]:
    """The quaternion x y z w of the composed rotation first · second."""
    ax, ay, az, aw = first
    bx, by, bz, bw = second
    return (aw * bx + ax * bw + ay * bz - az * by, aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw, aw * bw - ax * bx - ay * by - az * bz)


def conjugate(quaternion: Sequence[float]) -> tuple[float, float, float, float]:
    """The quaternion of the inverse rotation."""
    x, y, z, w = quaternion
    return -x, -y, -z, w


def turned(quaternion: Sequence[float], vector: Sequence[float]) -> tuple[float, float, float]:
    """The vector (3,), rotated by the quaternion."""
    (x, y, z, w), (a, b, c) = quaternion, vector
    u, v, t = 2.0 * (y * c - z * b), 2.0 * (z * a - x * c), 2.0 * (x * b - y * a)
    return a + w * u + y * t - z * v, b + w * v + z * u - x * t, c + w * t + x * v - y * u


def angle_between(first: Array, second: Array) -> float:
    """The angle (0 to π) of the rotation from one pose (7,) to another."""
    x, y, z, w = product(conjugate(first[3:].tolist()), second[3:].tolist())
    return 2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), abs(w))


def check_matrix(matrix: Array) -> None:
    """PoseError unless `matrix` (4, 4) is a finite rigid transform."""
    if matrix.shape != (4, 4):
        raise PoseError(f"a transform is a 4×4 matrix, not one of shape {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise PoseError("the numbers of a transform must be finite")
    if not np.array_equal(matrix[3], (0.0, 0.0, 0.0, 1.0)):
        raise PoseError("the last row of a transform must be 0 0 0 1")
    rotation = matrix[:3, :3]
    if not np.abs(rotation @ rotation.T - np.eye(3)).max() <= ROTATION_TOLERANCE or np.linalg.det(rotation) < 0:
        raise PoseError("the upper left 3×3 of a transform must be a rotation")


def inverse(matrix: Array) -> Array:
    """The inverse of a rigid 4×4 matrix."""
    result = np.eye(4)
    rotation = matrix[:3, :3].T
    result[:3, :3] = rotation
    result[:3, 3] = -(rotation @ matrix[:3, 3])
    return result


def rotation_vector(matrix: Array) -> Array:
    """Axis times angle (3,) of the rotation in a 3×3 or 4×4 matrix; the angle is in [0, π]."""
    (a, b, c), (d, e, f), (g, h, i) = matrix[:3, :3].tolist()
    x, y, z, w = quaternion_of(a, b, c, d, e, f, g, h, i)
    sine = math.sqrt(x * x + y * y + z * z)
    # near zero angle/sine tends to 2, and the quotient below would be 0/0
    factor = 2.0 if sine < 1e-12 else 2.0 * math.atan2(sine, w) / sine
    return np.array((x * factor, y * factor, z * factor))


def rotation_from_vector(vector: Array) -> Array:
    """The 3×3 rotation of a rotation vector (3,)."""
    x, y, z = (float(v) for v in vector)
    angle = math.sqrt(x * x + y * y + z * z)
    factor = 0.5 if angle < 1e-12 else math.sin(0.5 * angle) / angle
    pose = np.array((0.0, 0.0, 0.0, x * factor, y * factor, z * factor, math.cos(0.5 * angle)))
    return matrix_from_pose(pose)[:3, :3]


def quaternion_of(
    a: float, b: float, c: float, d: float, e: float, f: float, g: float, h: float, i: float
) -> tuple[float, float, float, float]:
    """The quaternion x y z w of the rotation (a b c), (d e f), (g h i), by the branch with the largest divisor."""
    trace = a + e + i
    if trace >= max(a, e, i):
        x, y, z, w = h - f, c - g, d - b, 1.0 + trace
    elif a >= e and a >= i:
        x, y, z, w = 1.0 + a - e - i, b + d, c + g, h - f
    elif e >= i:
        x, y, z, w = b + d, 1.0 - a + e - i, f + h, c - g
    else:
        x, y, z, w = c + g, f + h, 1.0 - a - e + i, d - b
    length = math.copysign(math.sqrt(x * x + y * y + z * z + w * w), w)
    return x / length, y / length, z / length, w / length
