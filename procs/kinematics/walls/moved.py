"""Walls that move with another arm: the segments of its body, each a capsule, or a wall that hangs at its tip."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.frames import Frame, product
from trocar.procs.kinematics.poses import Array, inverse
from trocar.procs.kinematics.walls.body import INSERTION, ArmBody
from trocar.procs.native.library import chosen
from trocar.procs.native.walls_fields import MOVED

Z: Final = np.array((0.0, 0.0, 1.0))
ALWAYS: Final = np.ones(1, dtype=np.bool_)
BEYOND_M, BEYOND_RAD, BEYOND_WRIST_RAD = 0.1, 1.0, math.tau
"""An arm that is measured further outside its limits is not there; discs that hold no instrument may be anywhere."""
NEVER_OLD: Final = np.zeros(1, dtype=np.int64)


class MovedWalls:
    """Keeps `frames` (t, 3, 4) and lengths in `size` (t, 3) of an arm's walls where another arm is.

    `relation` (3, 4): the pose of the other arm's base in this arm's base or, where `by_tip` (1,) is not 0, of its tip.
    """

    def __init__(self, kinematics: Kinematics, body: ArmBody, to_joint: Array, position: Array,
                 biased: NDArray[np.bool_] = ALWAYS, age_ns: NDArray[np.int64] = NEVER_OLD) -> None:
        """Of the other arm; `position` (axes,) are its measured actuators, joints = `to_joint` (n, axes) · position.

        `biased`, `age_ns` (1,): whether its encoders are set, and the age of the sample in io's record.
        """
        self.kinematics, self.body = kinematics, body
        self.to_joint, self.position, self.axes = np.ascontiguousarray(to_joint), position, len(position)
        self.relation, self.pose = np.zeros((2, 3, 4))
        self.biased, self.age_ns, self.by_tip = biased, age_ns, np.zeros(1, dtype=np.int64)
        self.p = len(body.of)
        turns = np.where(np.arange(kinematics.n) > INSERTION, BEYOND_WRIST_RAD, BEYOND_RAD)
        beyond = np.where(kinematics.is_prismatic, BEYOND_M, turns)
        self.least, self.most = kinematics.lower - beyond, kinematics.upper + beyond
        self.follow: Callable[[], int]
        self.follow_all: Callable[[int, int, int], int]

    def fill(self, frames: Array, size: Array, pose: Array | None) -> None:
        """Set the walls that move: one at a `pose` (4, 4) in the frame of the tip; None: the segments of the body."""
        self.hangs = int(pose is not None)
        self.starts, self.stops = np.zeros((2, 0), dtype=np.int64)
        if pose is None:
            self.starts, self.stops = self.body.starts[self.body.solid], self.body.stops[self.body.solid]
            size[:, 0] = self.body.radius[self.body.solid]
        else:
            self.pose[...] = pose[:3]
        self.frames, self.size, self.s, self.t = frames, size, len(self.starts), len(frames)
        self.follow, self.follow_all = chosen(MOVED, self, "by_numpy_")

    # the reference of the native library

    def by_numpy_follow_all(self, addresses: int, count: int, most_ns: int) -> int:
        """Whether all are measured; without the native library each follows alone."""
        return 0

    def by_numpy_follow(self) -> int:
        """Move the walls to where the arm is measured; returns 0, and leaves them, if that cannot be."""
        q = self.to_joint @ self.position
        if not ((self.least <= q) & (q <= self.most)).all():
            return 0
        frames = self.kinematics.links.frames(q.tolist())
        tip = np.vstack((np.reshape(self.kinematics.tip_after(frames), (3, 4)), (0.0, 0.0, 0.0, 1.0)))
        to = self.relation @ inverse(tip) if self.by_tip.item() else self.relation
        if self.hangs:
            self.frames[0] = np.reshape(product((to @ tip).ravel().tolist(), self.pose.ravel().tolist()), (3, 4))
        points = [np.einsum("ij,j->i", to, self._point(frames, i)) for i in range(self.p)]
        for i, (start, stop) in enumerate(zip(self.starts.tolist(), self.stops.tolist(), strict=True)):
            way = points[stop] - points[start]
            self.size[i, 1] = length = math.sqrt(float(way @ way))
            self.frames[i] = _along(points[start], way / length if length > 0.0 else Z)
        return 1

    def _point(self, frames: Sequence[Frame], i: int) -> Array:
        """A point of the body in its base, and 1."""
        place, joint = np.append(self.body.place[i], 1.0), int(self.body.of[i])
        return place if joint < 0 else np.append(np.einsum("ij,j->i", np.reshape(frames[joint], (3, 4)), place), 1.0)


def _along(place: Array, z: Array) -> Array:
    """A frame (3, 4) at a place, with its z in a direction."""
    axis = np.eye(3)[int(np.abs(z).argmin())]
    x = np.cross(z, axis)
    x /= math.sqrt(float(x @ x))
    return np.stack((x, np.cross(z, x), z, place), axis=1)
