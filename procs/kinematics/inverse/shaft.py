"""Arms with a remote centre of motion: the shaft passes through it; its direction gives yaw and pitch.

Depth along the shaft is insertion and a constant. Poses are (4, 4) in the chain's base frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from procs.document.system import Chain, DhLink
from procs.kinematics.denavit import split_row

Array = NDArray[np.float64]
Triple = tuple[float, float, float]

TINY: Final = 1e-12
ROOM: Final = 1e-3  # rad or m beyond a limit where a solution is still worked out


class Shaft:
    """Yaw, pitch, insertion and roll of an arm with a remote centre, whatever comes after the roll."""

    def __init__(self, chain: Chain, links: tuple[DhLink, ...], tip: Array) -> None:
        """`links` are those of the arm and its tool; `tip` (4, 4) follows the last."""
        self.n = len(links)
        self.befores = [split_row(chain.convention, link)[0] for link in links]
        self._turns = [row[:3, :3] for row in self.befores]
        self._from_base = rigid_inverse(np.array(chain.base)) if chain.base is not None else np.eye(4)
        self.centre = np.array(chain.base)[:3, 3] if chain.base is not None else np.zeros(3)
        self._from_tip = rigid_inverse(tip)
        self._depth = links[2].d + links[2].offset + links[3].d  # of the roll frame, less insertion
        self._ranges = [(link.lower - ROOM, link.upper + ROOM) for link in links[:3]]

    def last_frame(self, goal: Array) -> Array:
        """Frame (4, 4) of the last link, seen from the remote centre, for a goal of the tip."""
        result: Array = self._from_base @ goal @ self._from_tip
        return result

    def joints(self, along: Triple, depth: float) -> Array:
        """(n,) with yaw, pitch and insertion of a shaft in direction `along`; the others are NaN."""
        q = np.full(self.n, np.nan)
        q[0], q[1] = math.atan2(along[0], -along[2]), math.asin(max(-1.0, min(1.0, -along[1])))
        q[2] = depth - self._depth
        return q

    def within(self, q: Array) -> bool:
        """Yaw, pitch and insertion are within their limits, or nearly."""
        return all(low <= value <= high for value, (low, high) in zip(q[:3].tolist(), self._ranges, strict=True))

    def rotation(self, q: Array) -> Array:
        """Rotation (3, 3) of the insertion frame."""
        turns = self._turns
        result: Array = turns[0] @ about_z(q[0]) @ turns[1] @ about_z(q[1]) @ turns[2]
        return result

    def turned(self, joint: int, before: Array, after: Array) -> float:
        """Position of a revolute joint between the frame of the link before and that of its own, (3, 3) each."""
        turn = self._turns[joint].T @ before.T @ after
        return math.atan2(turn[1, 0] - turn[0, 1], turn[0, 0] + turn[1, 1])


def both_ways(wrist: Triple) -> Iterator[tuple[Triple, float]]:
    """Direction and depth of a shaft through the remote centre to `wrist`: as it is inserted, then backwards."""
    depth = math.sqrt(sum(each * each for each in wrist))
    if depth > TINY:
        for towards in (depth, -depth):
            yield (wrist[0] / towards, wrist[1] / towards, wrist[2] / towards), towards


def rigid_inverse(pose: Array) -> Array:
    """The inverse (4, 4) of a rigid transform."""
    result = np.eye(4)
    result[:3, :3] = pose[:3, :3].T
    result[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return result


def cross(a: Triple, b: Triple) -> Triple:
    """a × b: for three numbers a tenth of numpy's time."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def about_x(angle: float) -> Array:
    """Rotation (3, 3) about x."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array(((1.0, 0.0, 0.0), (0.0, c, -s), (0.0, s, c)))


def about_y(angle: float) -> Array:
    """Rotation (3, 3) about y."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array(((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c)))


def about_z(angle: float) -> Array:
    """Rotation (3, 3) about z."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array(((c, -s, 0.0), (s, c, 0.0), (0.0, 0.0, 1.0)))
