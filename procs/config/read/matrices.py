"""Checks of matrices, which files have as rows."""

from __future__ import annotations

import numpy as np

from trocar.procs.config.loading.context import Opened
from trocar.procs.config.read.problem import KeyPath
from trocar.procs.config.read.units import FRAME, check_unit

Rows = tuple[tuple[float, ...], ...]

_ORTHONORMAL = 1e-3  # files round cosines to four digits
_MIN_DETERMINANT = 1e-6


def check_size(opened: Opened[object], key: KeyPath, matrix: Rows, size: int) -> bool:
    """Whether `matrix` is size × size; an error otherwise."""
    if len(matrix) == size and all(len(row) == size for row in matrix):
        return True
    shape = f"{len(matrix)} rows of {'/'.join(str(n) for n in sorted({len(row) for row in matrix}))}"
    opened.error(key, f"wrong size: {shape} numbers", f"{size} rows of {size} numbers")
    return False


def check_rigid(opened: Opened[object], key: KeyPath, matrix: Rows) -> bool:
    """Whether `matrix` is a 4 × 4 rigid transform; an error otherwise."""
    if not check_size(opened, key, matrix, 4):
        return False
    values = np.array(matrix)
    rotation = values[:3, :3]
    if not np.array_equal(values[3], [0.0, 0.0, 0.0, 1.0]):
        opened.error(key, f"last row is {list(matrix[3])}", "0, 0, 0, 1")
        return False
    with np.errstate(all="ignore"):  # absurd numbers overflow, and are refused like others
        off = float(np.abs(rotation @ rotation.T - np.eye(3)).max())
        handed = float(np.linalg.det(rotation))
    if not off <= _ORTHONORMAL or not handed > 0.0:
        opened.error(key, f"not a rotation (off by {off:.2g})", "orthonormal right-handed axes, to 0.001")
        return False
    check_unit(opened, key, max((row[3] for row in matrix[:3]), key=abs), FRAME)
    return True


def check_invertible(opened: Opened[object], key: KeyPath, matrix: Rows, size: int) -> bool:
    """Whether `matrix` is size × size and has an inverse; an error otherwise."""
    if not check_size(opened, key, matrix, size):
        return False
    with np.errstate(all="ignore"):
        determinant = abs(float(np.linalg.det(np.array(matrix))))
    if not _MIN_DETERMINANT <= determinant < np.inf:
        opened.error(key, "has no inverse", "an invertible matrix")
        return False
    return True
