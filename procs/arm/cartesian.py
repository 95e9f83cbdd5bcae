"""Poses, twist and Jacobian of the tip, in the arm's base and in the reference frame."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from procs.arm.readings import Fields
from procs.lib.kinematics import Kinematics
from procs.lib.poses import pose_from_matrix

Array = NDArray[np.float64]


class Cartesian:
    """The Cartesian part of an arm's record. `base` is the pose of the arm's base in the reference frame."""

    def __init__(self, field: Fields) -> None:
        """`field` gives the arrays of the arm's own record."""
        self._measured, self._setpoint = field("measured_cp"), field("setpoint_cp")
        self._local_measured, self._local_setpoint = field("local_measured_cp"), field("local_setpoint_cp")
        self._twist, self._jacobian = field("measured_cv"), field("jacobian")
        self._base_pose, self._base_valid = field("base_frame"), field("reference_valid")
        self._valid = field("cartesian_valid")
        self._is_base_known = True
        self._is_identity = True
        self._base = np.eye(4)
        self._tip = np.eye(4)
        self._body_twist = np.zeros(6)

    def set_base(self, base: Array | None) -> None:
        """The base's pose (4, 4) in the reference frame; None: it is not known, only local poses are valid."""
        self._is_base_known = base is not None
        self._base_valid[...] = False  # until the next update
        if base is not None:
            self._base[...] = base
            self._is_identity = bool(np.array_equal(base, np.eye(4)))
            pose_from_matrix(self._base, self._base_pose)

    def clear(self) -> None:
        """Nothing Cartesian is valid."""
        self._valid[...] = False
        self._base_valid[...] = False

    def update(self, kinematics: Kinematics, position: Array, velocity: Array, setpoint: Array) -> None:
        """Fill the record from measured joint position and velocity and the set-point, (n,) each."""
        self._valid[...] = True
        self._base_valid[...] = self._is_base_known
        self._fill(kinematics.fk(setpoint), self._local_setpoint, self._setpoint)
        kinematics.update(position)
        body = kinematics.body
        self._jacobian[:, : kinematics.n] = body
        self._fill(kinematics.tip, self._local_measured, self._measured)
        np.matmul(body, velocity, out=self._body_twist)
        rotation = kinematics.tip[:3, :3] if self._is_identity else self._tip[:3, :3]
        np.matmul(rotation, self._body_twist[:3], out=self._twist[:3])
        np.matmul(rotation, self._body_twist[3:], out=self._twist[3:])

    def _fill(self, local: Array, local_out: Array, out: Array) -> None:
        pose_from_matrix(local, local_out)
        if self._is_identity:
            out[...] = local_out
        else:
            np.matmul(self._base, local, out=self._tip)
            pose_from_matrix(self._tip, out)
