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
        self._body_rows, self._twist_rows = self._body_twist.reshape(2, 3), self._twist.reshape(2, 3)
        self._tip_rotation = self._tip[:3, :3]
        self._shown: Array | None = None
        self._setpoint_done = b""

    def set_base(self, base: Array | None) -> None:
        """The base's pose (4, 4) in the reference frame; None: it is not known, only local poses are valid."""
        self._is_base_known = base is not None
        self._base_valid[...] = False  # until the next update
        self._setpoint_done = b""
        if base is not None:
            self._base[...] = base
            self._is_identity = bool(np.array_equal(base, np.eye(4)))
            pose_from_matrix(self._base, self._base_pose)

    def clear(self) -> None:
        """Nothing Cartesian is valid; the chain may be another one next time."""
        self._shown = None
        self._valid[...] = False
        self._base_valid[...] = False

    def update(self, kinematics: Kinematics, position: Array, velocity: Array, setpoint: Array) -> None:
        """Fill the record from measured joint position and velocity and the set-point, (n,) each."""
        self._valid[...] = True
        self._base_valid[...] = self._is_base_known
        if self._shown is None:
            self._shown = self._jacobian[:, : kinematics.n]
            self._setpoint_done = b""
        wanted = setpoint.tobytes()
        if wanted != self._setpoint_done:  # an arm that holds needs this once
            self._setpoint_done = wanted
            self._fill(kinematics.fk(setpoint), self._local_setpoint, self._setpoint)
        kinematics.update(position)
        self._shown[...] = kinematics.body
        self._fill(kinematics.tip, self._local_measured, self._measured)
        np.matmul(kinematics.body, velocity, out=self._body_twist)
        rotation = kinematics.tip[:3, :3] if self._is_identity else self._tip_rotation
        np.matmul(self._body_rows, rotation.T, out=self._twist_rows)

    def _fill(self, local: Array, local_out: Array, out: Array) -> None:
        pose_from_matrix(local, local_out)
        if self._is_identity:
            out[...] = local_out
        else:
            np.matmul(self._base, local, out=self._tip)
            pose_from_matrix(self._tip, out)
