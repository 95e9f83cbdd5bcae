"""Poses, twist and Jacobian of the tip, in the base and in the reference frame: native code, else Python."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from trocar.procs.arm.joints import JointSpace
from trocar.procs.arm.readings import ArmReadings
from trocar.procs.kinematics.frames import (
    Frame,
    Rows,
    body_jacobian,
    dot,
    finite,
    pose_of,
    product,
    shortest,
    spatial_jacobian,
    times,
    transposed,
    turned_back,
    turned_twist,
)
from trocar.procs.kinematics.poses import Array, inverse, pose_from_matrix
from trocar.procs.native.arm_fields import CARTESIAN
from trocar.procs.native.library import chosen
from trocar.procs.node.inputs import Fields
from trocar.procs.node.requests import CommandRefused
from trocar.procs.tables.arm_types import base_name


class Cartesian:
    """The Cartesian part of an arm's record. `base` is the pose of the arm's base in the reference frame.

    `frame` and `local_frame` are the names of the reference frame and of the base.

    `tip` and `rotation` are the measured tip's pose (4, 4) in the arm's base and its axes (3, 3) in the reference
    frame, `twist` (6,) the tip's twist in the reference frame; `jacobian` (6, count) is the body Jacobian, `spatial`
    that at the base's origin. They belong to this cycle, and hold while `valid`. In the record, wrenches and the
    spatial Jacobian are filled while they are wanted, and NaN otherwise.
    """

    DAMPING: Final = 1e-12  # for wrenches and rates at a singular Jacobian: only keeps them finite
    WRENCHES: Final = 1
    SPATIAL: Final = 2
    EVERYTHING: Final = WRENCHES | SPATIAL
    """The values that are computed on demand."""

    def __init__(self, field: Fields, io: ArmReadings, arm: str) -> None:
        """`field` gives the arrays of the own record of `arm`."""
        self.io, self.frame, self.local_frame = io, "", base_name(arm)
        self._shown_frame = field("reference_frame")
        self.frame_bytes = self._shown_frame.dtype.itemsize
        """Room for the name of a frame."""
        self.measured, self.setpoint = field("measured_cp"), field("setpoint_cp")
        self.local_measured, self.local_setpoint = field("local_measured_cp"), field("local_setpoint_cp")
        self.twist, self.setpoint_twist = field("measured_cv"), field("setpoint_cv")
        self.body_twist = field("local_measured_cv")
        self.shown_body, self.shown_spatial = field("jacobian"), field("spatial_jacobian")
        self.columns = self.shown_body.shape[1]
        self.body_wrench, self.spatial_wrench = field("body_measured_cf"), field("spatial_measured_cf")
        self._base_pose, self._base_valid = field("base_frame"), field("reference_valid")
        self._valid = field("cartesian_valid")
        self.valid = False
        self.complete = True
        """Every joint position is known; a master's roll only after its stop was found."""
        self.base_known = True
        self.frames: dict[str, bool] = {}
        """The frames that are known now: whether they are that of the arm's base, see `is_local`."""
        self._is_identity = True
        self.base, self.to_base = np.eye(4), np.eye(4)
        self.tip, self.reference_tip = np.eye(4), np.eye(4)
        self.rotation: Array = self.reference_tip[:3, :3]
        self.absolute = False
        """Body wrenches are in the axes of the reference frame, not the tip's."""
        self.wanted_twist = np.zeros(6)
        self._setpoint_done = b""
        self._is_done = False
        """The newest measured values are in the record."""
        self._shown_absolute = False
        self._count = self._wanted = 0

    def use(self, joints: JointSpace) -> None:
        """Use another joint space; `ArmReadings` must have it already."""
        n, io = joints.count, self.io
        self._count = n
        self.shown_body[...] = self.shown_spatial[...] = 0.0
        self._blank(self.EVERYTHING)
        self._setpoint_motion = io.rows[3:5]
        self.size = io.rows.shape[1]
        self.has_free = int(joints.free is not None)
        self.free = np.eye(n) if joints.free is None else np.ascontiguousarray(joints.free)
        self.m = self.free.shape[1]
        self.found_rates = np.zeros(n)
        self._kinematics = joints.kinematics
        if joints.kinematics is not None:
            self.kinematics = joints.kinematics
            self.tip, self.jacobian = joints.kinematics.tip, joints.kinematics.body
            self._show, self._rates = chosen(CARTESIAN, self, "by_numpy_")
        self.clear()

    def set_base(self, base: Array | None) -> None:
        """Set the base's pose (4, 4) in the reference frame; None: unknown, only local poses are valid."""
        self.base_known = base is not None
        self._know_frames()
        self._base_valid[...] = False
        self._setpoint_done, self._is_done = b"", False
        if base is not None:
            self.base[...] = base
            self.to_base[...] = inverse(base)
            self._is_identity = bool(np.array_equal(base, np.eye(4)))
            pose_from_matrix(self.base, self._base_pose)
            if self.valid:
                self.update()  # so that no record lacks poses that were known before and after

    def name_frame(self, name: str) -> None:
        """Set the name of the reference frame."""
        self.frame, self._shown_frame[...] = name, name.encode()
        self._know_frames()

    def _know_frames(self) -> None:
        known = dict.fromkeys(("", self.frame), False) if self.base_known else {}
        self.frames = {**known, self.local_frame: True}

    def is_local(self, frame: str) -> bool:
        """Whether a command in this frame is in the arm's base; otherwise it is in the reference frame.

        Without a name it is in the reference frame; CommandRefused for the name of any other frame.
        """
        if frame == self.local_frame:
            return True
        if frame in ("", self.frame):
            return False
        raise CommandRefused(f"frame {frame}; allowed: {', '.join(dict.fromkeys((self.frame, self.local_frame)))}")

    def need_base(self) -> None:
        """CommandRefused while the base frame is not known."""
        if not self.base_known:
            raise CommandRefused("the arm's base frame is not known")

    def want(self, wanted: int) -> None:
        """Compute those of WRENCHES and SPATIAL from now on; the others are NaN until then."""
        if wanted != self._wanted:
            self._blank(self._wanted & ~wanted)
            self._wanted = wanted
            self._is_done = False

    def _blank(self, unwanted: int) -> None:
        if unwanted & self.WRENCHES:
            self.body_wrench[...] = self.spatial_wrench[...] = math.nan
        if unwanted & self.SPATIAL:
            self.shown_spatial[:, : self._count] = math.nan

    @property
    def spatial(self) -> Array:
        """See above; computed on access."""
        return self.kinematics.spatial_jacobian(self.io.rows[0, : self.kinematics.n])

    def to_local(self, pose: Array) -> Array:
        """A pose (4, 4) of the reference frame, in the arm's base."""
        return pose if self._is_identity else self.to_base @ pose

    def to_reference(self, pose: Array) -> Array:
        """A pose (4, 4) of the arm's base, in the reference frame."""
        return pose if self._is_identity else self.base @ pose

    def turned(self, values: Array) -> Array:
        """A twist or wrench (6,) in axes of the arm's base, in those of the reference frame."""
        return (values.reshape(2, 3) @ self.base[:3, :3].T).reshape(6)

    def wrench_at_base(self, wrench: Array) -> Array:
        """A wrench (6,) at the origin of the reference frame, in its axes, at that of the arm's base, in its axes."""
        force, torque = wrench[:3], wrench[3:] - np.cross(self.base[:3, 3], wrench[:3])
        return (np.stack((force, torque)) @ self.base[:3, :3]).reshape(6)

    def clear(self) -> None:
        """Mark all Cartesian values as invalid."""
        self.valid = False
        self._valid[...] = False
        self._base_valid[...] = False
        self._setpoint_done, self._is_done = b"", False

    def update(self) -> None:
        """Fill the record from this cycle's readings, if they are valid and there is a tip."""
        kinematics = self._kinematics
        if kinematics is None or not self.io.valid or not self.complete:
            if self.valid:
                self.clear()
            return
        wanted = self._setpoint_motion.tobytes()
        is_new = wanted != self._setpoint_done  # once is enough for an arm that holds
        if not is_new and self._is_done and not self.io.changed and self.absolute is self._shown_absolute:
            return  # a kinematic robot at rest
        if not self._is_done:
            self.valid = self._is_done = True
            self._valid[...] = True
            self._base_valid[...] = self.base_known
        self._shown_absolute = self.absolute
        self._setpoint_done = wanted
        kinematics.forget()
        self._show(is_new, self.absolute, self._wanted)

    def rates(self, twist: Array) -> Array:
        """Joint velocities (count,) for a twist (6,) of the measured tip in the reference frame: pinv(J) · twist.

        The next call overwrites them.
        """
        self.wanted_twist[...] = twist
        self._rates()
        return self.found_rates

    # the reference of the native library

    def by_numpy_show(self, is_new: int, absolute: int, parts: int) -> int:
        """Fill all of the record: the setpoint if it `is_new`, and wanted values of the rest."""
        kinematics, n = self.kinematics, self.kinematics.n
        slides = kinematics.is_prismatic.tolist()
        position, velocity, effort, wanted, wanted_velocity = self.io.rows[:5, :n].tolist()
        if is_new:
            frames = kinematics.links.frames(finite(wanted))
            tip = kinematics.tip_after(frames)
            reference = self._show_pose(tip, self.local_setpoint, self.setpoint)
            self.setpoint_twist[...] = 0.0
            if any(wanted_velocity):
                body = body_jacobian(frames, slides, tip)
                self.setpoint_twist[...] = turned_twist(reference, times(transposed(body), wanted_velocity))
        frames = kinematics.links.frames(finite(position))
        tip = kinematics.tip_after(frames)
        kinematics.tip[:3].reshape(12)[...] = tip
        kinematics.body_columns[...] = body_jacobian(frames, slides, tip)
        self.shown_body[:, :n] = kinematics.body
        if parts & self.SPATIAL:
            self.shown_spatial[:, :n] = np.transpose(spatial_jacobian(frames, slides))
        reference = self._show_pose(tip, self.local_measured, self.measured)
        self.reference_tip[:3].reshape(12)[...] = reference
        twist = times(kinematics.body.tolist(), velocity)
        self.body_twist[...] = twist
        self.twist[...] = turned_twist(reference, twist)
        if parts & self.WRENCHES:
            self._show_wrenches(tip, reference, effort, absolute)
        return 0

    def _show_wrenches(self, tip: Frame, reference: Frame, effort: list[float], absolute: int) -> None:
        wrench = self._wrench(effort)
        self.body_wrench[...] = turned_twist(reference, wrench) if absolute else wrench
        a, b, c, d, e, f = turned_twist(tip, wrench)
        x, y, z = tip[3], tip[7], tip[11]
        self.spatial_wrench[...] = (a, b, c, d + y * c - z * b, e + z * a - x * c, f + x * b - y * a)

    def by_numpy_rates(self) -> int:
        """`found_rates` for `wanted_twist`."""
        twist = turned_back(self.reference_tip[:3].reshape(12).tolist(), self.wanted_twist.tolist())
        found = self._any_shortest(self._rows(), twist)
        self.found_rates[...] = times(self.free.tolist(), found) if self.has_free else found
        return 0

    def _rows(self) -> Rows:
        """The body Jacobian (6, m) for the independent coordinates."""
        rows: Rows = self.kinematics.body.tolist()
        return [times(self.free.T.tolist(), row) for row in rows] if self.has_free else rows

    def _wrench(self, effort: list[float]) -> list[float]:
        """The wrench at the tip, in its axes, equivalent to the efforts: pinv(Jᵀ) · effort."""
        if not any(effort):  # a kinematic robot
            return [0.0] * 6
        if self.has_free:  # joints that bend together receive efforts together
            effort = times(self.free.T.tolist(), effort)
        return self._any_shortest(transposed(self._rows()), effort)

    def _any_shortest(self, rows: Rows, wanted: list[float]) -> list[float]:
        """The shortest x, or zeros if there is none."""
        x = shortest(rows, wanted, self.DAMPING)
        return x if math.isfinite(dot(x, x)) else [0.0] * len(x)

    def _show_pose(self, local: Frame, local_out: Array, out: Array) -> Frame:
        """Write the pose in both frames; returns the tip in the reference frame."""
        reference = product(self.base[:3].reshape(12).tolist(), local)
        local_out[...] = pose_of(local)
        out[...] = pose_of(reference)
        return reference
