"""Vectors of three numbers, and frames of which only the rotation counts: at this size, a tenth of numpy's time.

Frames are those of procs/kinematics/frames.py; their `product` and `moved` turn rotations, too.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from trocar.procs.kinematics.frames import Frame

Triple = tuple[float, float, float]


def place_of(f: Frame) -> Triple:
    """The origin of a frame."""
    return f[3], f[7], f[11]


def back(f: Frame) -> Frame:
    """The inverse rotation."""
    a, b, c, _, d, e, h, _, i, j, k, _ = f
    return a, d, i, 0.0, b, e, j, 0.0, c, h, k, 0.0


def turned(f: Frame, v: Sequence[float]) -> Triple:
    """A vector, turned by the rotation."""
    x, y, z = v
    return f[0] * x + f[1] * y + f[2] * z, f[4] * x + f[5] * y + f[6] * z, f[8] * x + f[9] * y + f[10] * z


def columns(x: Triple, y: Triple, z: Triple) -> Frame:
    """The rotation with these axes."""
    return x[0], y[0], z[0], 0.0, x[1], y[1], z[1], 0.0, x[2], y[2], z[2], 0.0


def about_x(angle: float) -> Frame:
    """Rotation about x."""
    c, s = math.cos(angle), math.sin(angle)
    return 1.0, 0.0, 0.0, 0.0, 0.0, c, -s, 0.0, 0.0, s, c, 0.0


def about_y(angle: float) -> Frame:
    """Rotation about y."""
    c, s = math.cos(angle), math.sin(angle)
    return c, 0.0, s, 0.0, 0.0, 1.0, 0.0, 0.0, -s, 0.0, c, 0.0


def inner(a: Sequence[float], b: Sequence[float]) -> float:
    """a · b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a: Triple, b: Triple) -> Triple:
    """a × b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def scaled(a: Triple, factor: float) -> Triple:
    """factor · a."""
    return a[0] * factor, a[1] * factor, a[2] * factor


def added(a: Triple, b: Triple, factor: float = 1.0) -> Triple:
    """a + factor · b."""
    return a[0] + b[0] * factor, a[1] + b[1] * factor, a[2] + b[2] * factor
