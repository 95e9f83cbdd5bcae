"""Rotations as nine numbers, row by row, and vectors of three: at this size, a tenth of numpy's time."""

from __future__ import annotations

import math
from collections.abc import Sequence

Turn = Sequence[float]
Triple = tuple[float, float, float]


def turn_of(frame: Sequence[float]) -> Turn:
    """The rotation of a frame (procs/kinematics/frames.py)."""
    a, b, c, _, d, e, f, _, g, h, i, _ = frame
    return a, b, c, d, e, f, g, h, i


def product(a: Turn, b: Turn) -> Turn:
    """a · b."""
    c, d, e, f, g, h, i, j, k = a
    p, q, r, s, t, u, v, w, x = b
    return (c * p + d * s + e * v, c * q + d * t + e * w, c * r + d * u + e * x,
            f * p + g * s + h * v, f * q + g * t + h * w, f * r + g * u + h * x,
            i * p + j * s + k * v, i * q + j * t + k * w, i * r + j * u + k * x)


def back(a: Turn) -> Turn:
    """The inverse rotation."""
    c, d, e, f, g, h, i, j, k = a
    return c, f, i, d, g, j, e, h, k


def turned(a: Turn, angle: float) -> Turn:
    """a · Rz(angle)."""
    c, d, e, f, g, h, i, j, k = a
    cosine, sine = math.cos(angle), math.sin(angle)
    return (c * cosine + d * sine, d * cosine - c * sine, e, f * cosine + g * sine, g * cosine - f * sine, h,
            i * cosine + j * sine, j * cosine - i * sine, k)


def moved(a: Turn, v: Sequence[float]) -> Triple:
    """a · v."""
    x, y, z = v
    return a[0] * x + a[1] * y + a[2] * z, a[3] * x + a[4] * y + a[5] * z, a[6] * x + a[7] * y + a[8] * z


def columns(x: Triple, y: Triple, z: Triple) -> Turn:
    """The rotation with these axes."""
    return x[0], y[0], z[0], x[1], y[1], z[1], x[2], y[2], z[2]


def about_x(angle: float) -> Turn:
    """Rotation about x."""
    c, s = math.cos(angle), math.sin(angle)
    return 1.0, 0.0, 0.0, 0.0, c, -s, 0.0, s, c


def about_y(angle: float) -> Turn:
    """Rotation about y."""
    c, s = math.cos(angle), math.sin(angle)
    return c, 0.0, s, 0.0, 1.0, 0.0, -s, 0.0, c


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
