"""Inverse of an ECM: four joints, so a goal is a position and a turn about the shaft; the position fixes the view."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from trocar.procs.document.system import Chain
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.frames import Frame, product
from trocar.procs.kinematics.inverse.shaft import TINY, Shaft, both_ways, frame_of
from trocar.procs.kinematics.inverse.solver import InverseSolver
from trocar.procs.kinematics.inverse.turns import Triple, added, cross, inner, place_of, scaled
from trocar.procs.kinematics.poses import Array, inverse

MAX_TILT: Final = 0.5 * math.pi
FURTHEST_TILT: Final = 3.1  # rad; beyond, the direction of the tilt is undefined
PLACE_AND_ROLL: Final = (0, 1, 2, 5)  # rows of the twist that four joints can control


class EndoscopeShaft:
    """ECM: four joints, so a goal is a position and a turn about the shaft; the position fixes the view."""

    def __init__(self, chain: Chain, tip: Array) -> None:
        """`chain` is yaw, pitch, insertion, roll; `tip` (4, 4) of the endoscope."""
        self._shaft = Shaft(chain, chain.links, np.eye(4))
        self._from_tip = frame_of(inverse(tip))

    def attainable(self, goal: Array) -> tuple[Frame, float]:
        """Frame of the roll joint for a goal (4, 4) of the tip, and the tilt that aligned the goal with the shaft."""
        frame = product(frame_of(goal), self._from_tip)
        _, _, a, x, _, _, b, y, _, _, c, z = frame
        along = added((x, y, z), self._shaft.centre, -1.0)
        depth = math.sqrt(inner(along, along))
        if not TINY <= depth < math.inf:
            return frame, 0.0
        along = scaled(along, 1.0 / depth)
        axis = cross((a, b, c), along)
        sine = math.sqrt(inner(axis, axis))
        cosine = inner((a, b, c), along)
        tilt = math.atan2(sine, cosine)
        if sine > TINY and tilt < FURTHEST_TILT:
            frame = product(_tilt(axis, cosine), frame)
            frame = (*frame[:3], x, *frame[4:7], y, *frame[8:11], z)
        return frame, tilt

    def solutions(self, goal: Array, seed: Array) -> Iterator[list[float]]:
        """The shaft as inserted, then backwards; `goal` is a frame of the roll joint."""
        end = self._shaft.last_frame(frame_of(goal))
        for along, depth in both_ways(place_of(end)):
            q = self._shaft.joints(along, depth)
            q[3] = self._shaft.turned(3, self._shaft.rotation(q), end)
            yield q


def _tilt(axis: Triple, cosine: float) -> Frame:
    """The rotation about an axis whose length is the sine of its angle."""
    x, y, z = axis
    k = 1.0 / (1.0 + cosine)
    return (cosine + x * x * k, x * y * k - z, x * z * k + y, 0.0,
            x * y * k + z, cosine + y * y * k, y * z * k - x, 0.0,
            x * z * k - y, y * z * k + x, cosine + z * z * k, 0.0)


class EndoscopeInverse(InverseSolver):
    """Solver of an ECM: a goal that does not look along the shaft is tilted; `tilt` [rad] is the angle.

    A goal that needs a tilt by more than a right angle is refused.
    """

    is_direct = False

    def __init__(self, chain: Chain, tip: Array) -> None:
        self._endoscope = EndoscopeShaft(chain, tip)
        super().__init__(Kinematics(chain), self._endoscope, rows=PLACE_AND_ROLL)
        self.tilt, self._frame = 0.0, np.eye(4)

    def solve(self, goal: Array, seed: Array) -> bool:
        """Joints whose tip has the position of `goal` (4, 4) and its turn about the shaft."""
        frame, self.tilt = self._endoscope.attainable(goal)
        self._frame[:3].reshape(12)[...] = frame
        if self.tilt > MAX_TILT:
            np.copyto(self.q, seed)
            self.reason, self.axis = f"the goal looks {math.degrees(self.tilt):.3g} deg away from the shaft", -1
            return False
        return super().solve(self._frame, seed)

    def approach(self, goal: Array, at: Array, most: Array) -> None:
        """See InverseSolver; the goal's direction of view is ignored."""
        self._frame[:3].reshape(12)[...] = self._endoscope.attainable(goal)[0]
        super().approach(self._frame, at, most)
