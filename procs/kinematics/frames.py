"""Rigid frames and small systems of equations in scalar Python: the operations of the native library, in the same
order.

A frame is the upper three rows of a rigid transform: twelve numbers. One frame is too little work for numpy's per-call
cost, and its matrix products are not bit-identical on all machines.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from trocar.procs.kinematics.poses import quaternion_of

Frame = Sequence[float]
Rows = list[list[float]]

SAME_TURN: Final = 1e-12  # sine of half an angle
SMALL_TURN: Final = 1e-8  # rad², below which a series is used


def finite(q: list[float]) -> list[float]:
    """Joints with NaN for values that are not finite, because sine and cosine of NaN are NaN as well."""
    return q if math.isfinite(dot(q, q)) else [x if math.isfinite(x) else math.nan for x in q]


def product(f: Frame, g: Frame) -> Frame:
    """f · g."""
    a, b, c, x, d, e, h, y, i, j, k, z = f
    p, q, r, u, s, t, m, v, n, o, l_, w = g
    return (a * p + b * s + c * n, a * q + b * t + c * o, a * r + b * m + c * l_, a * u + b * v + c * w + x,
            d * p + e * s + h * n, d * q + e * t + h * o, d * r + e * m + h * l_, d * u + e * v + h * w + y,
            i * p + j * s + k * n, i * q + j * t + k * o, i * r + j * m + k * l_, i * u + j * v + k * w + z)


def moved(f: Frame, slides: bool, q: float) -> Frame:
    """f, moved along (prismatic) or about its own z by q."""
    a, b, c, x, d, e, h, y, i, j, k, z = f
    if slides:
        return a, b, c, x + c * q, d, e, h, y + h * q, i, j, k, z + k * q
    cosine, sine = math.cos(q), math.sin(q)
    return (a * cosine + b * sine, b * cosine - a * sine, c, x, d * cosine + e * sine, e * cosine - d * sine, h, y,
            i * cosine + j * sine, j * cosine - i * sine, k, z)


def body_jacobian(frames: Sequence[Frame], slides: Sequence[bool], tip: Frame) -> Rows:
    """Columns (n, 6) of the body Jacobian of joints that move along or about z of `frames`."""
    a, b, c, px, d, e, h, py, i, j, k, pz = tip
    body = []
    for f, along in zip(frames, slides, strict=True):
        x, y, z, ox, oy, oz = f[2], f[6], f[10], f[3], f[7], f[11]
        turned = [a * x + d * y + i * z, b * x + e * y + j * z, c * x + h * y + k * z]
        if along:
            body.append([*turned, 0.0, 0.0, 0.0])
            continue
        u, v, w = px - ox, py - oy, pz - oz
        q, r, s = y * w - z * v, z * u - x * w, x * v - y * u
        body.append([a * q + d * r + i * s, b * q + e * r + j * s, c * q + h * r + k * s, *turned])
    return body


def spatial_jacobian(frames: Sequence[Frame], slides: Sequence[bool]) -> Rows:
    """Columns (n, 6) of the spatial Jacobian of such joints."""
    spatial = []
    for f, along in zip(frames, slides, strict=True):
        x, y, z, ox, oy, oz = f[2], f[6], f[10], f[3], f[7], f[11]
        spatial.append([x, y, z, 0.0, 0.0, 0.0] if along else
                       [oy * z - oz * y, oz * x - ox * z, ox * y - oy * x, x, y, z])
    return spatial


def twist_between(f: Frame, g: Frame) -> list[float]:
    """The twist (6,) that takes f to g in unit time, in axes of f: the logarithm of f⁻¹ · g."""
    a, b, c, x, d, e, h, y, i, j, k, z = f
    p, q, r, u, s, t, m, v, n, o, l_, w = g
    u, v, w = u - x, v - y, w - z
    px, py, pz = a * u + d * v + i * w, b * u + e * v + j * w, c * u + h * v + k * w
    x, y, z, cosine = quaternion_of(
        a * p + d * s + i * n, a * q + d * t + i * o, a * r + d * m + i * l_,
        b * p + e * s + j * n, b * q + e * t + j * o, b * r + e * m + j * l_,
        c * p + h * s + k * n, c * q + h * t + k * o, c * r + h * m + k * l_)
    sine = math.sqrt(x * x + y * y + z * z)
    factor = 2.0 if sine < SAME_TURN else 2.0 * math.atan2(sine, cosine) / sine
    x, y, z = x * factor, y * factor, z * factor
    square, along = x * x + y * y + z * z, x * px + y * py + z * pz
    bend = 1.0 / 12.0 + square / 720.0 if square < SMALL_TURN else (1.0 - 0.5 * factor * cosine) / square
    return [px - 0.5 * (y * pz - z * py) + bend * (x * along - square * px),
            py - 0.5 * (z * px - x * pz) + bend * (y * along - square * py),
            pz - 0.5 * (x * py - y * px) + bend * (z * along - square * pz), x, y, z]


def pose_of(f: Frame) -> tuple[float, ...]:
    """x y z, quaternion x y z w of length 1 with w >= 0."""
    a, b, c, x, d, e, h, y, i, j, k, z = f
    return x, y, z, *quaternion_of(a, b, c, d, e, h, i, j, k)


def turned_twist(f: Frame, v: Sequence[float]) -> list[float]:
    """Both halves of (6,), from the axes of f to those of its parent frame."""
    a, b, c, _, d, e, h, _, i, j, k, _ = f
    x, y, z, p, q, r = v
    return [a * x + b * y + c * z, d * x + e * y + h * z, i * x + j * y + k * z,
            a * p + b * q + c * r, d * p + e * q + h * r, i * p + j * q + k * r]


def turned_back(f: Frame, v: Sequence[float]) -> list[float]:
    """Both halves of (6,), into the axes of f."""
    a, b, c, _, d, e, h, _, i, j, k, _ = f
    x, y, z, p, q, r = v
    return [a * x + d * y + i * z, b * x + e * y + j * z, c * x + h * y + k * z,
            a * p + d * q + i * r, b * p + e * q + j * r, c * p + h * q + k * r]


def dot(a: Sequence[float], b: Sequence[float]) -> float:
    """Σ a · b, summed from the first element on."""
    total = 0.0
    for x, y in zip(a, b, strict=True):
        total += x * y
    return total


def times(rows: Rows, v: Sequence[float]) -> list[float]:
    """rows · v."""
    return [dot(row, v) for row in rows]


def transposed(rows: Rows) -> Rows:
    """Columns as rows."""
    return [list(column) for column in zip(*rows, strict=True)]


def squared(rows: Rows, damping: float) -> Rows:
    """rows · rowsᵀ, with the damping added to its diagonal."""
    result = [[dot(a, b) for b in rows] for a in rows]
    for i, row in enumerate(result):
        row[i] += damping
    return result


def solve(a: Rows, x: list[float]) -> bool:
    """x := a⁻¹ · x, which also changes a; False if a is singular."""
    n = len(x)
    for k in range(n):
        best = k
        for i in range(k + 1, n):
            if abs(a[i][k]) > abs(a[best][k]):
                best = i
        a[k], a[best], x[k], x[best] = a[best], a[k], x[best], x[k]
        row, pivot = a[k], a[k][k]
        if pivot == 0.0:
            return False
        for i in range(k + 1, n):
            other = a[i]
            factor = other[k] / pivot
            for j in range(k + 1, n):
                other[j] -= factor * row[j]
            x[i] -= factor * x[k]
    for k in range(n - 1, -1, -1):
        row = a[k]
        for j in range(k + 1, n):
            x[k] -= row[j] * x[j]
        x[k] /= row[k]
    return True


def shortest(rows: Rows, wanted: Sequence[float], damping: float) -> list[float]:
    """The shortest x that minimizes the distance from rows · x to `wanted`: the damped pseudo-inverse; NaN if that
    fails.
    """
    columns = transposed(rows)
    if len(rows) <= len(columns):
        y = list(wanted)
        is_solved, x = solve(squared(rows, damping), y), times(columns, y)
    else:
        x = times(columns, wanted)
        is_solved = solve(squared(columns, damping), x)
    return x if is_solved else [math.nan] * len(x)
