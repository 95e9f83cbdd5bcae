"""Poses, twist and Jacobian of the tip, in the arm's base and in the reference frame."""

from __future__ import annotations

import eigenpy
import numpy as np
from numpy.typing import NDArray

from procs.arm.joints import JointSpace
from procs.arm.readings import ArmReadings, Fields
from procs.kinematics.forward import Kinematics
from procs.kinematics.poses import inverse, pose_from_matrix

Array = NDArray[np.float64]

DAMPING = 1e-12  # of wrenches and rates where the Jacobian is singular: no number but a finite one is right there


class Cartesian:
    """The Cartesian part of an arm's record. `base` is the pose of the arm's base in the reference frame.

    `tip` and `rotation` are the measured tip's pose (4, 4) and axes (3, 3), in the arm's base and in the reference
    frame, `twist` (6,) its own in the reference frame; `jacobian` (6, count) is the body Jacobian, `spatial` that at
    the base's origin. They hold while `valid`, and are this cycle's.
    """

    def __init__(self, field: Fields, io: ArmReadings) -> None:
        """`field` gives the arrays of the arm's own record."""
        self._io = io
        self._measured, self._setpoint = field("measured_cp"), field("setpoint_cp")
        self._local_measured, self._local_setpoint = field("local_measured_cp"), field("local_setpoint_cp")
        self.twist, self._setpoint_twist = field("measured_cv"), field("setpoint_cv")
        self._jacobian, self._spatial = field("jacobian"), field("spatial_jacobian")
        self._body_wrench, self._spatial_wrench = field("body_measured_cf"), field("spatial_measured_cf")
        self._base_pose, self._base_valid = field("base_frame"), field("reference_valid")
        self._valid = field("cartesian_valid")
        self.valid = False
        self.complete = True
        """Every joint tells where it is; a master's roll only does once its stop was found."""
        self.base_known = True
        self._is_identity = True
        self.base, self._to_base = np.eye(4), np.eye(4)
        self.tip, self._reference_tip = np.eye(4), np.eye(4)
        self.rotation: Array = self.tip[:3, :3]
        self.absolute = False
        """Wrenches of the body are in the axes of the reference frame, not the tip's."""
        self._body_twist = field("local_measured_cv")
        self._body_rows, self.twist_rows = self._body_twist.reshape(2, 3), self.twist.reshape(2, 3)
        self._setpoint_body, self._setpoint_rows = np.zeros(6), self._setpoint_twist.reshape(2, 3)
        self._wrench = np.zeros(6)
        self._ldlt = eigenpy.LDLT(np.eye(6))  # a third of numpy's overhead
        self._wrench_rows, self._body_wrench_rows = self._wrench.reshape(2, 3), self._body_wrench.reshape(2, 3)
        self._spatial_rows = self._spatial_wrench.reshape(2, 3)
        self._setpoint_done = b""
        self._is_done = False
        """What was measured last is in the record."""
        self._shown_absolute = False
        self._is_squared = self._is_short = False

    def use(self, joints: JointSpace) -> None:
        """Another joint space; `ArmReadings` must have it already."""
        n, io, kinematics = joints.count, self._io, joints.kinematics
        self._kinematics = kinematics
        self._jacobian[...] = self._spatial[...] = 0.0
        self._shown, self.spatial = self._jacobian[:, :n], self._spatial[:, :n]
        self._position, self._velocity, self._setpoint_position = io.position[:n], io.velocity[:n], io.setpoint[:n]
        self._setpoint_motion = io.rows[3:5, :n]
        self._setpoint_velocity, self._effort = io.setpoint_velocity[:n], io.effort[:n]
        if kinematics is not None:
            self.tip, self.jacobian = kinematics.tip, kinematics.body  # of the setpoint for a moment, see update
        self._free = joints.free
        self._is_short = n < 6
        self._damping = DAMPING * np.eye(min(n, 6))
        self.clear()

    def set_base(self, base: Array | None) -> None:
        """The base's pose (4, 4) in the reference frame; None: it is not known, only local poses are valid."""
        self.base_known = base is not None
        self._base_valid[...] = False
        self._setpoint_done, self._is_done = b"", False
        if base is not None:
            self.base[...] = base
            self._to_base = inverse(base)
            self._is_identity = bool(np.array_equal(base, np.eye(4)))
            pose_from_matrix(self.base, self._base_pose)
            if self.valid:
                self.update()  # no record is without poses that were known before and after

    def to_local(self, pose: Array) -> Array:
        """A pose (4, 4) of the reference frame, in the arm's base."""
        return pose if self._is_identity else self._to_base @ pose

    def to_reference(self, pose: Array) -> Array:
        """A pose (4, 4) of the arm's base, in the reference frame."""
        return pose if self._is_identity else self.base @ pose

    def clear(self) -> None:
        """Nothing Cartesian is valid."""
        self.valid = False
        self._valid[...] = False
        self._base_valid[...] = False
        self._setpoint_done, self._is_done = b"", False

    def update(self) -> None:
        """Fill the record from this cycle's readings, if they are valid and there is a tip."""
        kinematics = self._kinematics
        if kinematics is None or not self._io.valid or not self.complete:
            if self.valid:
                self.clear()
            return
        wanted = self._setpoint_motion.tobytes()
        is_new = wanted != self._setpoint_done  # an arm that holds needs this once
        if not is_new and self._is_done and not self._io.changed and self.absolute is self._shown_absolute:
            return  # a kinematic robot at rest
        self.valid = self._is_done = True
        self._shown_absolute = self.absolute
        self._valid[...] = True
        self._base_valid[...] = self.base_known
        if is_new:
            self._setpoint_done = wanted
            self._show_setpoint(kinematics)
        kinematics.update(self._position)
        self._shown[...] = kinematics.body
        self.spatial[...] = kinematics.spatial
        self._fill(kinematics.tip, self._local_measured, self._measured)
        self.rotation = kinematics.tip[:3, :3] if self._is_identity else self._reference_tip[:3, :3]
        np.matmul(kinematics.body, self._velocity, out=self._body_twist)
        np.matmul(self._body_rows, self.rotation.T, out=self.twist_rows)
        self._show_wrench(kinematics)

    def _show_setpoint(self, kinematics: Kinematics) -> None:
        if not any(self._setpoint_velocity.tolist()):  # the Jacobian is not needed
            self._fill(kinematics.fk(self._setpoint_position), self._local_setpoint, self._setpoint)
            self._setpoint_twist[...] = 0.0
            return
        kinematics.update(self._setpoint_position)
        self._fill(kinematics.tip, self._local_setpoint, self._setpoint)
        rotation = kinematics.tip[:3, :3] if self._is_identity else self._reference_tip[:3, :3]
        np.matmul(kinematics.body, self._setpoint_velocity, out=self._setpoint_body)
        np.matmul(self._setpoint_body.reshape(2, 3), rotation.T, out=self._setpoint_rows)

    def rates(self, twist: Array) -> Array:
        """Joint velocities (count,) for a twist (6,) of the measured tip in the reference frame: pinv(J) · twist."""
        turned = (twist.reshape(2, 3) @ self.rotation).reshape(6)  # Rᵀ · v, in rows
        body = self.jacobian if self._free is None else self.jacobian @ self._free
        square = self._squared(body)
        rates: Array = square.solve(body.T @ turned) if self._is_short else body.T @ square.solve(turned)
        return rates if self._free is None else self._free @ rates

    def _squared(self, body: Array) -> eigenpy.LDLT:
        """The smaller one of Jᵀ·J and J·Jᵀ of this cycle, ready to solve with."""
        if not self._is_squared:
            self._is_squared = True
            self._ldlt.compute((body.T @ body if self._is_short else body @ body.T) + self._damping)
        return self._ldlt

    def _show_wrench(self, kinematics: Kinematics) -> None:
        """The wrench at the tip that the efforts amount to: pinv(Jᵀ) · effort, of the body and at the base's origin."""
        self._is_squared = False
        if not any(self._effort.tolist()):  # a kinematic robot
            self._body_wrench[...] = self._spatial_wrench[...] = 0.0
            return
        body, effort = kinematics.body, self._effort
        if self._free is not None:  # joints that bend together are pushed together
            body, effort = body @ self._free, effort @ self._free
        square = self._squared(body)
        self._wrench[...] = body @ square.solve(effort) if self._is_short else square.solve(body @ effort)
        local = kinematics.tip[:3, :3]
        if self.absolute:
            np.matmul(self._wrench_rows, self.rotation.T, out=self._body_wrench_rows)
        else:
            self._body_wrench[...] = self._wrench
        np.matmul(self._wrench_rows, local.T, out=self._spatial_rows)
        x, y, z = kinematics.tip[:3, 3].tolist()
        a, b, c, d, e, f = self._spatial_wrench.tolist()
        self._spatial_wrench[3:] = (d + y * c - z * b, e + z * a - x * c, f + x * b - y * a)

    def _fill(self, local: Array, local_out: Array, out: Array) -> None:
        pose_from_matrix(local, local_out)
        if self._is_identity:
            out[...] = local_out
        else:
            np.matmul(self.base, local, out=self._reference_tip)
            pose_from_matrix(self._reference_tip, out)
