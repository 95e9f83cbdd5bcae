"""Joint efforts that hold an arm against gravity, from the masses of its links: native code, else Python.

`up` (3,) is g · (0, sin p, cos p) in the chain's base frame, p the mounting pitch: the acceleration equivalent to
gravity, so that the efforts are the holding efforts. An Si arm has a parallelogram: its few joints move a longer chain
of links (`kinematic_gc`), whose efforts are added up in the joints.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from trocar.procs.document.system import Chain
from trocar.procs.kinematics.forward import Links
from trocar.procs.kinematics.frames import dot, finite, times
from trocar.procs.kinematics.poses import Array
from trocar.procs.native.arm_fields import GRAVITY
from trocar.procs.native.library import chosen

STANDARD_GRAVITY: Final = 9.81  # m/s², as in the reference
# Rows are links, columns joints: how the links of Si arms follow, and whose efforts a joint carries.
PSM_SI_LINKS: Final = np.array(((1, 0, 0), (0, 0, 0), (0, 1, 0), (0, -1, 0), (0, 1, 0), (0, 0, 0.5), (0, 0, 0.5)))
PSM_SI_BEARS: Final = np.array(((1, 0, 0), (0, 0, 0), (0, 1, 0), (0, -1, 0), (0, 1, 0), (0, 0, 0), (0, 0, 1.0)))
ECM_SI_LINKS: Final = np.array(((1, 0, 0), (0, 0, 0), (0, 1, 0), (0, -1, 0), (0, 1, 0), (0, 0, 1.0)))
ECM_SI_BEARS: Final = ECM_SI_LINKS
SHAPES: Final = {7: (PSM_SI_LINKS, PSM_SI_BEARS), 6: (ECM_SI_LINKS, ECM_SI_BEARS)}
"""For Si arms, by the number of their links."""
CAMERA_LINK: Final = {4: 2, 6: 5}
"""Index of the ECM link that carries the endoscope, by the number of links."""


def up_of(mounting_pitch: float) -> Array:
    """(3,) for an arm mounted at a pitch [rad]."""
    return STANDARD_GRAVITY * np.array((0.0, math.sin(mounting_pitch), math.cos(mounting_pitch)))


class Gravity:
    """Gravity of one arm. `effort(q)` (n,) is preallocated: the next call overwrites it; n is the arm's number of
    joints.
    """

    def __init__(self, links: Chain, joints: int, up: Array, camera_mass: float | None = None) -> None:
        """`links` have masses; `joints` is the number of the arm's joints. `camera_mass` [kg] is that of an ECM's
        endoscope.

        ValueError if the links are neither the joints themselves nor those of an Si arm.
        """
        count = len(links.links)
        if count == joints:
            follow, bear = np.eye(count), np.eye(count)
        elif count in SHAPES and joints >= 3:
            follow, bear = SHAPES[count]
        else:
            raise ValueError(f"{links.source or 'chain'}: {count} links do not belong to an arm of {joints} joints")
        self.links = Links(links, links.links)
        self.masses = np.array([link.mass for link in links.links])
        if camera_mass is not None:
            if count not in CAMERA_LINK:
                raise ValueError(f"{links.source or 'chain'}: no link of {count} carries an endoscope")
            self.masses[CAMERA_LINK[count]] = camera_mass
        ends = self.links.ends[1:].reshape(count, 12).tolist()
        self.centres = np.array([_seen(end, link.com) for end, link in zip(ends, links.links, strict=True)])
        """Centres of mass (n, 3), relative to the links' joints."""
        self.follow, self.bear = follow.copy(), np.ascontiguousarray(bear.T)
        self.moved = follow.shape[1]
        self.up = np.array(up, dtype=np.float64)
        self.q, self.efforts = np.zeros(self.moved), np.zeros(joints)
        self.borne = self.efforts[: self.moved]
        (self._hold,) = chosen(GRAVITY, self, "by_numpy_")

    def effort(self, q: Array) -> Array:
        """Holding efforts [N·m or N] at joint positions q (n,); 0 for joints without load (wrists)."""
        self.q[...] = q[: self.moved]
        self._hold()
        return self.efforts

    def by_numpy_hold(self) -> int:
        """The reference of the native library: the effect of the mass after each joint, from the last link on."""
        frames = self.links.frames(finite(times(self.follow.tolist(), self.q.tolist())))
        slides, up = self.links.slides.tolist(), self.up.tolist()
        mass, moment, torques = 0.0, [0.0, 0.0, 0.0], [0.0] * len(frames)
        for i in range(len(frames) - 1, -1, -1):
            f, own = frames[i], float(self.masses[i])
            mass += own
            moment = [x + own * y for x, y in zip(moment, _seen(f, self.centres[i].tolist()), strict=True)]
            z = f[2], f[6], f[10]
            if slides[i]:
                torques[i] = mass * dot(up, z)
                continue
            x, y, w = (m - mass * o for m, o in zip(moment, (f[3], f[7], f[11]), strict=True))
            torques[i] = dot(up, (z[1] * w - z[2] * y, z[2] * x - z[0] * w, z[0] * y - z[1] * x))
        self.borne[...] = times(self.bear.tolist(), torques)
        return 0


def _seen(f: Sequence[float], point: Sequence[float]) -> list[float]:
    """A point (3,) of the frame f, in f's parent frame."""
    x, y, z = point
    return [f[r] * x + f[r + 1] * y + f[r + 2] * z + f[r + 3] for r in (0, 4, 8)]
