"""The body of an arm as far as walls know it: a line of segments from the remote centre to the tip.

Arms without a remote centre (masters) have their tip only.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from trocar.procs.document.walls import INSTRUMENT, JAW, SHAFT, TIP
from trocar.procs.kinematics.forward import Kinematics
from trocar.procs.kinematics.poses import Array

INSERTION: Final = 2  # the joint that makes a remote centre: it slides along the shaft
THICK, THIN, CAMERA = 0.0042, 0.0025, 0.006  # m: radii of instruments of 8 and 5 mm, of an endoscope
SAME: Final = 1e-6  # m
_TIP, _JAW, _SHAFT, _WRIST = 1, 2, 4, 8
PART_BITS: Final = {TIP: _TIP, JAW: _JAW, SHAFT: _SHAFT, INSTRUMENT: _TIP | _JAW | _SHAFT | _WRIST}


class ArmBody:
    """Points and segments of one arm with its instrument.

    `of` (p,): the joint that carries a point, -1: none; `place` (p, 3): its place in the frame of that joint. `starts`,
    `stops`, `parts`, `radius` (s,): the points of a segment, the bits of its part, and its radius in m; `solid` (s,):
    it has an extent. `reach` (n,): no point moves faster for a velocity 1 of a joint.
    """

    def __init__(self, kinematics: Kinematics, radius: float, jaw_length: float = 0.0) -> None:
        """`radius` of the shaft, `jaw_length` from the tip on, along its z: both in m; without a jaw 0."""
        links, n = kinematics.links, kinematics.n
        end = kinematics.end[:, 3]
        self.has_remote_centre = n > INSERTION and bool(links.slides[INSERTION])
        spots = [(n - 1, end)]
        if self.has_remote_centre:
            joints = [(joint, np.zeros(3)) for joint in range(INSERTION + 1, n)]
            spots = [(-1, links.placements[0][:, 3]), *joints, *spots]
        if jaw_length:
            spots.append((n - 1, end + jaw_length * kinematics.end[:, 2]))
        spots = _distinct(kinematics, spots)
        self.of = np.array([joint for joint, _ in spots])
        self.place = np.array([place for _, place in spots], dtype=np.float64).reshape(-1, 3)
        last = len(spots) - 1
        tip = last - bool(jaw_length)
        rows = [(i, i + 1, _WRIST if i < tip else _JAW, radius) for i in range(last)] + [(tip, tip, _TIP, 0.0)]
        if self.has_remote_centre:
            rows[0] = (0, 1, _SHAFT, radius)
        self.starts, self.stops, self.parts = (np.array([row[i] for row in rows]) for i in range(3))
        self.radius = np.array([row[3] for row in rows])
        self.solid = self.parts != _TIP
        way = spots if self.has_remote_centre else [*((joint, np.zeros(3)) for joint in range(n)), *spots]
        self.reach = _reach(kinematics, way)

    def has(self, part: str) -> bool:
        """Whether this body has a part, or any of it."""
        return bool((self.parts & PART_BITS[part]).any())


Spots = Sequence[tuple[int, Array]]


def points_at(kinematics: Kinematics, q: Array, spots: Spots) -> Array:
    """Points (p, 3) of a body at joints (n,), in the arm's base."""
    frames = [np.array(frame).reshape(3, 4) for frame in kinematics.links.frames(q.tolist())]
    return np.array([place if joint < 0 else frames[joint][:, :3] @ place + frames[joint][:, 3]
                     for joint, place in spots])


def _corners(kinematics: Kinematics) -> list[Array]:
    """Joints at both ends of the insertion, with the others at zero and at a place without symmetry."""
    bent = np.linspace(0.3, 0.7, kinematics.n)
    found = []
    for joints in (np.zeros(kinematics.n), bent):
        for limit in (kinematics.lower, kinematics.upper):
            q = joints.copy()
            q[kinematics.is_prismatic] = limit[kinematics.is_prismatic]
            found.append(q)
    return found


def _distinct(kinematics: Kinematics, spots: Spots) -> list[tuple[int, Array]]:
    """Without points that are always where the one before them is; the last of them stays."""
    ways = [points_at(kinematics, q, spots) for q in _corners(kinematics)]
    apart = [max(float(np.linalg.norm(points[i + 1] - points[i])) for points in ways) > SAME
             for i in range(len(spots) - 1)]
    return [spot for spot, is_apart in zip(spots, [*apart, True], strict=True) if is_apart]


def _reach(kinematics: Kinematics, way: Spots) -> Array:
    """See `ArmBody`: 1 for a joint that slides, else the length of the `way` from its axis to the tip."""
    reach = np.ones(kinematics.n)
    for joint in np.flatnonzero(~kinematics.is_prismatic).tolist():
        after = [spot for spot in way if spot[0] >= joint]
        most = 0.0
        for q in _corners(kinematics):
            points = points_at(kinematics, q, [(joint, np.zeros(3)), *after])
            most = max(most, float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()))
        reach[joint] = most
    return reach
