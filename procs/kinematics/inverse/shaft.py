"""Arms with a remote centre of motion: the shaft passes through it; its direction gives yaw and pitch.

Depth along the shaft is insertion and a constant. Frames are those of procs/kinematics/frames.py.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from trocar.procs.document.system import Chain, DhLink
from trocar.procs.kinematics.forward import split_row
from trocar.procs.kinematics.frames import Frame, moved, product
from trocar.procs.kinematics.inverse.turns import Triple
from trocar.procs.kinematics.poses import Array, inverse

TINY: Final = 1e-12
ROOM: Final = 1e-3  # rad or m beyond a limit up to which a solution is still computed


def frame_of(matrix: Array) -> Frame:
    """The frame of a matrix (4, 4)."""
    rows: list[float] = matrix[:3].ravel().tolist()
    return rows


class Shaft:
    """Yaw, pitch, insertion and roll of an arm with a remote centre, independent of the joints after the roll."""

    def __init__(self, chain: Chain, links: tuple[DhLink, ...], tip: Array) -> None:
        """`links` are those of the arm and its tool; `tip` (4, 4) follows the last."""
        self.n = len(links)
        self.frames = [frame_of(split_row(chain.convention, link)[0]) for link in links]
        """Frames of the links, before their joints move."""
        base = np.array(chain.base) if chain.base is not None else np.eye(4)
        self._from_base, self._from_tip = frame_of(inverse(base)), frame_of(inverse(tip))
        self.centre: Triple = (float(base[0, 3]), float(base[1, 3]), float(base[2, 3]))
        self._depth = links[2].d + links[2].offset + links[3].d  # of the roll frame, less insertion
        self._ranges = [(link.lower - ROOM, link.upper + ROOM) for link in links[:3]]

    def last_frame(self, goal: Frame) -> Frame:
        """Frame of the last link, relative to the remote centre, for a goal of the tip."""
        return product(product(self._from_base, goal), self._from_tip)

    def joints(self, along: Triple, depth: float) -> list[float]:
        """(n,) with yaw, pitch and insertion of a shaft in direction `along`; the others are NaN."""
        return [math.atan2(along[0], -along[2]), math.asin(max(-1.0, min(1.0, -along[1]))), depth - self._depth,
                *(math.nan,) * (self.n - 3)]

    def within(self, q: list[float]) -> bool:
        """Whether yaw, pitch and insertion are within their limits, or nearly."""
        return all(low <= value <= high for value, (low, high) in zip(q, self._ranges, strict=False))

    def rotation(self, q: list[float]) -> Frame:
        """Rotation of the insertion frame."""
        yaw, pitch, insertion, *_ = self.frames
        return product(moved(product(moved(yaw, False, q[0]), pitch), False, q[1]), insertion)

    def turned(self, joint: int, before: Frame, after: Frame) -> float:
        """Position of a revolute joint between the frame of the previous link and that of its own."""
        a, b, _, _, d, e, _, _, g, h, _, _ = product(before, self.frames[joint])
        p, q, _, _, s, t, _, _, v, w, _, _ = after
        return math.atan2(b * p + e * s + h * v - (a * q + d * t + g * w),
                          a * p + d * s + g * v + b * q + e * t + h * w)


def both_ways(wrist: Triple) -> Iterator[tuple[Triple, float]]:
    """Direction and depth of a shaft through the remote centre to `wrist`: as inserted, then backwards."""
    depth = math.sqrt(wrist[0] * wrist[0] + wrist[1] * wrist[1] + wrist[2] * wrist[2])
    if depth > TINY:
        for towards in (depth, -depth):
            yield (wrist[0] / towards, wrist[1] / towards, wrist[2] / towards), towards
