"""An ECM: four joints, so that a goal is a place and a turn about the shaft; where it looks follows from the place."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from procs.document.system import Chain
from procs.kinematics.forward import Kinematics
from procs.kinematics.inverse.shaft import TINY, Shaft, both_ways, cross, rigid_inverse
from procs.kinematics.inverse.solver import InverseSolver
from procs.kinematics.poses import rotation_from_vector

Array = NDArray[np.float64]

MAX_TILT: Final = 0.5 * math.pi
PLACE_AND_ROLL: Final = (0, 1, 2, 5)  # rows of the twist that four joints can have


class EndoscopeShaft:
    """ECM: four joints, so that a goal is a place and a turn about the shaft; where it looks follows from the place."""

    def __init__(self, chain: Chain, tip: Array) -> None:
        """`chain` is yaw, pitch, insertion, roll; `tip` (4, 4) of the endoscope."""
        self._shaft = Shaft(chain, chain.links, np.eye(4))
        self._from_tip = rigid_inverse(tip)

    def attainable(self, goal: Array) -> tuple[Array, float]:
        """Frame (4, 4) of the roll joint for a goal of the tip, and how far it had to be tilted to lie on the shaft."""
        frame = goal @ self._from_tip
        centre = self._shaft.centre
        along = frame[:3, 3] - centre
        depth = math.sqrt(along.dot(along))
        if depth < TINY:
            return frame, 0.0
        along = along / depth
        axis = np.array(cross(tuple(frame[:3, 2].tolist()), tuple(along.tolist())))
        sine = math.sqrt(axis.dot(axis))
        tilt = math.atan2(sine, float(frame[:3, 2].dot(along)))
        if sine > TINY:
            frame[:3, :3] = rotation_from_vector(axis * (tilt / sine)) @ frame[:3, :3]
        return frame, tilt

    def solutions(self, goal: Array, seed: Array) -> Iterator[Array]:
        """The shaft as it is inserted, then backwards; `goal` is a frame of the roll joint."""
        end = self._shaft.last_frame(goal)
        for along, depth in both_ways(tuple(end[:3, 3].tolist())):
            q = self._shaft.joints(along, depth)
            q[3] = self._shaft.turned(3, self._shaft.rotation(q), end[:3, :3])
            yield q


class EndoscopeInverse(InverseSolver):
    """Of an ECM: where its goal does not look along the shaft it is tilted; `tilt` [rad] tells by how much.

    A goal that would have to be tilted by more than a right angle is refused.
    """

    def __init__(self, chain: Chain, tip: Array) -> None:
        self._endoscope = EndoscopeShaft(chain, tip)
        super().__init__(Kinematics(chain), self._endoscope, rows=PLACE_AND_ROLL)
        self.tilt = 0.0

    def solve(self, goal: Array, seed: Array) -> bool:
        """Joints whose tip is where `goal` (4, 4) says, turned about the shaft as it says."""
        frame, self.tilt = self._endoscope.attainable(goal)
        if self.tilt > MAX_TILT:
            np.copyto(self.q, seed)
            self.reason, self.axis = f"the goal looks {math.degrees(self.tilt):.3g} deg away from the shaft", -1
            return False
        return super().solve(frame, seed)

    def approach(self, goal: Array, at: Array, most: Array) -> None:
        """See InverseSolver; where the goal looks to is not asked."""
        super().approach(self._endoscope.attainable(goal)[0], at, most)
