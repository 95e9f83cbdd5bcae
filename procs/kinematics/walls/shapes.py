"""Distances from shapes: the reference of procs/native/walls.c.

Every shape is convex, so its signed distance (negative inside) is a convex function of the place: along a segment it
has one minimum, and where a segment has to stay inside, one of its ends is the nearest place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from trocar.procs.document.walls import BOX, CAPSULE, CONE, CYLINDER, PLANE, SHAPES, SPHERE

Vector = Sequence[float]
APEX: Final = 1e-6
"""m: a segment that begins so near to the apex of a cone is judged by its end: a shaft through the remote centre."""
PARALLEL: Final = 1e-12
"""Squared sine of the angle below which a segment is parallel to a capsule."""
HALVINGS: Final = 20
"""Of a segment, to find its nearest place: 0.1 m / 2²⁰ is 0.1 µm."""


@dataclass(frozen=True, slots=True)
class Nearest:
    """The distance of a segment from a shape, at `along` (0 to 1) of it; `normal`: in which direction it grows."""

    value: float
    along: float = 0.0
    normal: tuple[float, float, float] = (0.0, 0.0, 0.0)


def _outside(beyond: Vector) -> tuple[float, list[float]]:
    """The distance from an edge or face, and its direction, from how far a point is outside along each axis."""
    square = sum(x * x for x in beyond if x > 0.0)
    if square == 0.0:
        most = max(range(len(beyond)), key=beyond.__getitem__)
        return beyond[most], [float(i == most) for i in range(len(beyond))]
    distance = math.sqrt(square)
    return distance, [x / distance if x > 0.0 else 0.0 for x in beyond]


def distance(shape: str, size: Vector, p: Vector) -> tuple[float, tuple[float, float, float]]:
    """Signed distance of a point in the frame of a shape, m, and its gradient. `size` (3,): see `size_of`."""
    radial = math.sqrt(p[0] * p[0] + p[1] * p[1])
    x, y = (p[0] / radial, p[1] / radial) if radial > 0.0 else (1.0, 0.0)
    if shape == BOX:
        d, (a, b, c) = _outside([abs(p[i]) - size[i] for i in range(3)])
        return d, (math.copysign(a, p[0]), math.copysign(b, p[1]), math.copysign(c, p[2]))
    if shape == CYLINDER:
        d, (a, b) = _outside([radial - size[0], abs(p[2]) - size[1]])
        return d, (a * x, a * y, math.copysign(b, p[2]))
    if shape == CONE:
        c, s = math.cos(size[0]), math.sin(size[0])
        length = math.sqrt(radial * radial + p[2] * p[2])
        if p[2] * c + radial * s < 0.0:
            return length, (radial / length * x, radial / length * y, p[2] / length)
        return radial * c - p[2] * s, (c * x, c * y, -s)
    if shape == PLANE:
        return p[2], (0.0, 0.0, 1.0)
    z = p[2] - (max(min(p[2], size[1]), 0.0) if shape == CAPSULE else 0.0)
    length = math.sqrt(radial * radial + z * z)
    towards = (radial / length * x, radial / length * y, z / length) if length > 0.0 else (1.0, 0.0, 0.0)
    return length - size[0], towards


def _along_axis(p: Vector, u: Vector, length: float) -> float:
    """How far along p + t · u (0 to 1) it is nearest to the piece of the z axis from 0 to `length`."""
    a, b, c, e, f = _dot(u, u), u[2] * length, _dot(u, p), length * length, length * p[2]
    from_start = max(min(-c / a, 1.0), 0.0)
    if e == 0.0:
        return from_start
    apart = a * e - b * b
    t = max(min((b * f - c * e) / apart, 1.0), 0.0) if apart > PARALLEL * a * e else from_start
    s = b * t + f
    if s < 0.0:
        return from_start
    return max(min((b - c) / a, 1.0), 0.0) if s > e else t


def nearest(kind: int, keeps_in: bool, frame: Sequence[float], size: Vector, a: Vector, b: Vector) -> Nearest:
    """The least distance of a segment from a shape at `frame` (12,), negative on the forbidden side."""
    shape = SHAPES[kind]
    p = turned_back(frame, [a[i] - frame[4 * i + 3] for i in range(3)])
    u = turned_back(frame, [b[i] - a[i] for i in range(3)])

    if shape == CONE and _dot(p, p) < APEX * APEX:
        p, u = turned_back(frame, [b[i] - frame[4 * i + 3] for i in range(3)]), (0.0, 0.0, 0.0)
    ends_only = not any(u)

    def at(along: float) -> tuple[float, tuple[float, float, float]]:
        return distance(shape, size, [p[i] + along * u[i] for i in range(3)])

    (first, g), (last, h) = at(0.0), at(1.0)
    if keeps_in:
        d, (x, y, z) = (last, h) if last > first else (first, g)
        return Nearest(-d, float(last > first or ends_only), _turned(frame, (-x, -y, -z)))
    low, high = 0.0, 1.0
    if shape in (SPHERE, CAPSULE) and not ends_only:
        low = high = _along_axis(p, u, size[1] if shape == CAPSULE else 0.0)
    elif _dot(g, u) >= 0.0:
        high = 0.0
    elif _dot(h, u) <= 0.0:
        low = 1.0
    for _ in range(HALVINGS if low < high and high > 0.0 and low < 1.0 else 0):
        half = 0.5 * (low + high)
        if _dot(at(half)[1], u) < 0.0:
            low = half
        else:
            high = half
    along = 0.0 if high == 0.0 else 1.0 if low == 1.0 else 0.5 * (low + high)
    d, g = at(along)
    along = 1.0 if ends_only else along
    return Nearest(d, along, _turned(frame, g))


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _turned(f: Vector, v: Vector) -> tuple[float, float, float]:
    """A vector of a frame, in the axes that the frame is seen from."""
    return _dot(f[0:3], v), _dot(f[4:7], v), _dot(f[8:11], v)


def turned_back(f: Vector, v: Vector) -> tuple[float, float, float]:
    """A vector of the frame that f is seen from, in axes of f."""
    return tuple(f[c] * v[0] + f[4 + c] * v[1] + f[8 + c] * v[2] for c in range(3))  # type: ignore[return-value]
