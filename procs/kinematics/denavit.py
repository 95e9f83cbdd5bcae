"""Denavit-Hartenberg rows as transforms, the way dVRK reads its kinematic files.

An alpha of exactly ±1.5708 means ±π/2, while offsets of 1.5708 are taken as written: the difference shows in the sixth
digit of every pose, and files and calibrations were made with it.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.system import DhLink

Array = NDArray[np.float64]

QUARTER_TURN_AS_WRITTEN = 1.5708  # in alpha only, this spelling means a right angle


def split_row(convention: str, link: DhLink) -> tuple[Array, Array]:
    """(before, after): the link's transform is before · joint motion about or along z · after, each (4, 4)."""
    alpha = math.copysign(math.pi / 2, link.alpha) if abs(link.alpha) == QUARTER_TURN_AS_WRITTEN else link.alpha
    prismatic = link.joint_type == "prismatic"
    about_z = _screw_z(link.theta + (0.0 if prismatic else link.offset), link.d + (link.offset if prismatic else 0.0))
    about_x = _screw_x(alpha, link.a)
    if convention == "standard":
        return about_z, about_x
    if convention == "modified":
        return about_x @ about_z, np.eye(4)
    raise ValueError(f"DH convention {convention!r}: must be standard or modified")


def _screw_z(angle: float, distance: float) -> Array:
    """Turn about z by `angle` and shift along z by `distance` (they commute), (4, 4)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array(((c, -s, 0.0, 0.0), (s, c, 0.0, 0.0), (0.0, 0.0, 1.0, distance), (0.0, 0.0, 0.0, 1.0)))


def _screw_x(angle: float, distance: float) -> Array:
    quarter = abs(angle) == math.pi / 2  # cos would leave 6e-17, and the zero is exact in the files' meaning
    c, s = (0.0 if quarter else math.cos(angle)), math.sin(angle)
    return np.array(((1.0, 0.0, 0.0, distance), (0.0, c, -s, 0.0), (0.0, s, c, 0.0), (0.0, 0.0, 0.0, 1.0)))
