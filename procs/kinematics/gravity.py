"""Joint efforts that hold an arm against gravity, from the masses of its links, on pinocchio.

`up` (3,) is g · (0, sin p, cos p) in the chain's base frame, p the mounting pitch: the acceleration that would feel
like gravity, so that efforts are those which hold. An Si arm stands on a parallelogram: its few joints move a longer
chain of links (`kinematic_gc`), the efforts of which come together in the joints.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import pinocchio
from numpy.typing import NDArray

from procs.document.system import Chain
from procs.kinematics.denavit import split_row

Array = NDArray[np.float64]

STANDARD_GRAVITY: Final = 9.81  # m/s², as the reference has it
# Rows are links, columns joints: how the links of Si arms follow, and whose efforts a joint bears.
PSM_SI_LINKS: Final = np.array(((1, 0, 0), (0, 0, 0), (0, 1, 0), (0, -1, 0), (0, 1, 0), (0, 0, 0.5), (0, 0, 0.5)))
PSM_SI_BEARS: Final = np.array(((1, 0, 0), (0, 0, 0), (0, 1, 0), (0, -1, 0), (0, 1, 0), (0, 0, 0), (0, 0, 1.0)))
ECM_SI_LINKS: Final = np.array(((1, 0, 0), (0, 0, 0), (0, 1, 0), (0, -1, 0), (0, 1, 0), (0, 0, 1.0)))
ECM_SI_BEARS: Final = ECM_SI_LINKS
SHAPES: Final = {7: (PSM_SI_LINKS, PSM_SI_BEARS), 6: (ECM_SI_LINKS, ECM_SI_BEARS)}
"""Of Si arms, by the number of their links."""
CAMERA_LINK: Final = {4: 2, 6: 5}
"""Which link of an ECM carries the endoscope, by the number of links."""


def up_of(mounting_pitch: float) -> Array:
    """(3,) for an arm mounted at a pitch [rad]."""
    return STANDARD_GRAVITY * np.array((0.0, math.sin(mounting_pitch), math.cos(mounting_pitch)))


class Gravity:
    """Of one arm. `effort(q)` (n,) is preallocated: the next call overwrites it; n is the arm's number of joints."""

    def __init__(self, links: Chain, joints: int, up: Array, camera_mass: float | None = None) -> None:
        """`links` have masses; `joints` are those of the arm. `camera_mass` [kg] is that of an ECM's endoscope.

        ValueError where the links are neither the joints themselves nor those of an Si arm.
        """
        count = len(links.links)
        if count == joints:
            follow, bear = np.eye(count), np.eye(count)
        elif count in SHAPES and joints >= 3:
            follow, bear = SHAPES[count]
        else:
            raise ValueError(f"{links.source or 'chain'}: {count} links do not belong to an arm of {joints} joints")
        masses = {}
        if camera_mass is not None:
            if count not in CAMERA_LINK:
                raise ValueError(f"{links.source or 'chain'}: no link of {count} carries an endoscope")
            masses[CAMERA_LINK[count]] = camera_mass
        self._follow, self._bear = follow.copy(), np.ascontiguousarray(bear.T)
        self._moved = follow.shape[1]
        self._model = _model(links, masses)
        self._model.gravity.linear = -np.asarray(up, dtype=np.float64)
        self._data = self._model.createData()
        self._links, self._effort = np.zeros(count), np.zeros(joints)

    def effort(self, q: Array) -> Array:
        """Holding efforts [N·m or N] at joint positions q (n,); 0 for joints that bear nothing (wrists)."""
        np.matmul(self._follow, q[: self._moved], out=self._links)
        torques = pinocchio.computeGeneralizedGravity(self._model, self._data, self._links)
        np.matmul(self._bear, torques, out=self._effort[: self._moved])
        return self._effort


def _model(chain: Chain, masses: dict[int, float]) -> pinocchio.Model:
    model = pinocchio.Model()
    before_next = np.array(chain.base) if chain.base is not None else np.eye(4)
    joint = 0
    for index, link in enumerate(chain.links):
        before, after = split_row(chain.convention, link)
        kind = pinocchio.JointModelPZ() if link.joint_type == "prismatic" else pinocchio.JointModelRZ()
        joint = model.addJoint(joint, kind, pinocchio.SE3(before_next @ before), f"{index} {link.name}")
        inertia = pinocchio.Inertia(masses.get(index, link.mass), np.array(link.com), np.array(link.inertia))
        model.appendBodyToJoint(joint, inertia, pinocchio.SE3(after))
        before_next = after
    return model
