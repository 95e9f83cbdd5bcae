"""Checks of matrices, which files have as rows, and warnings for positions likely in another unit: degrees, mm."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from trocar.procs.config.loading.context import Opened, Where

REVOLUTE: Final = "REVOLUTE"
PRISMATIC: Final = "PRISMATIC"
FRAME: Final = "FRAME"
_DOUBTS: Final = {REVOLUTE: (4.0 * math.pi, "rad", "degrees"), PRISMATIC: (2.0, "m", "mm"), FRAME: (10.0, "m", "mm")}
"""By joint type, and for frames, which may be across a room: a larger number is in doubt; the unit of files, and that
in which it may be instead."""


def check_unit(opened: Opened[object], key: Where, value: float, joint_type: str) -> None:
    """Warn if a position of a joint of this type, or a part of it, is so large that its unit is in doubt."""
    doubt = _DOUBTS.get(joint_type.upper())
    if doubt is not None and abs(value) > doubt[0]:
        largest, unit, other = doubt
        opened.warning(key, f"{value:g} {unit}: is this in {other}?", f"{unit}, usually within ±{largest:.4g}")


def check_range(opened: Opened[object], key: Where, lower: float, upper: float, joint_type: str) -> None:
    """Warn if a limit's unit is in doubt, or limits other than 0 allow no motion; `key` is that of the upper limit."""
    check_unit(opened, key, max(lower, upper, key=abs), joint_type)
    if lower == upper != 0.0:
        opened.warning(key, f"the joint has no range: both limits are {upper:g}", "lower limit below upper")


def check_tolerance(opened: Opened[object], key: Where, value: float, joint_type: str, way: float) -> None:
    """Warn if a tolerance never trips: larger than the range `way` of its joint (0: unknown), or in another unit."""
    if 0.0 < way < value:
        opened.warning(key, f"never exceeded: the joint moves {way:.4g} in all", f"below {way:.4g}")
    else:
        check_unit(opened, key, value, joint_type)


Rows = tuple[tuple[float, ...], ...]

_ORTHONORMAL = 1e-3  # files round cosines to four digits
_MIN_DETERMINANT = 1e-6


def check_size(opened: Opened[object], key: Where, matrix: Rows, size: int) -> bool:
    """Whether `matrix` is size × size; an error otherwise."""
    if len(matrix) == size and all(len(row) == size for row in matrix):
        return True
    shape = f"{len(matrix)} rows of {'/'.join(str(n) for n in sorted({len(row) for row in matrix}))}"
    opened.error(key, f"wrong size: {shape} numbers", f"{size} rows of {size} numbers")
    return False


def check_rigid(opened: Opened[object], key: Where, matrix: Rows) -> bool:
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


def check_invertible(opened: Opened[object], key: Where, matrix: Rows, size: int) -> bool:
    """Whether `matrix` is size × size and has an inverse; an error otherwise."""
    if not check_size(opened, key, matrix, size):
        return False
    with np.errstate(all="ignore"):
        determinant = abs(float(np.linalg.det(np.array(matrix))))
    if not _MIN_DETERMINANT <= determinant < np.inf:
        opened.error(key, "has no inverse", "an invertible matrix")
        return False
    return True
