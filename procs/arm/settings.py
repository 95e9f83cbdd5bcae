"""Commands for settings and queries: ratios, base frame, gravity compensation, kinematics of given joints."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from trocar.procs.arm.arm_commands import ArmCommandRow, Table
from trocar.procs.arm.control import Control
from trocar.procs.kinematics.poses import Array, given_pose, pose_from_matrix
from trocar.procs.node.requests import CommandRefused, switch
from trocar.procs.tables import codes
from trocar.shm.mailbox.received import Request

CRTK_VERSION: Final = "1.1.0"
POSE: Final = 7


class Settings:
    """Commands that do not need a ready arm."""

    def __init__(self, control: Control, base_from: str) -> None:
        """`base_from`: the setup joints that give the base frame, "" if commands do."""
        self._control, self._base_from, self._has_reported_no_model = control, base_from, False
        self.table: Table = {
            "trajectory_j/set_ratio": ArmCommandRow(
                lambda request: self._set_ratios(request.values[0], request.values[0])),
            "trajectory_j/set_ratio_v": ArmCommandRow(
                lambda request: self._set_ratios(request.values[0], control.motion.ratio_a)),
            "trajectory_j/set_ratio_a": ArmCommandRow(
                lambda request: self._set_ratios(control.motion.ratio_v, request.values[0])),
            "set_base_frame": ArmCommandRow(self._set_base_frame),
            "add_wall": ArmCommandRow(lambda request: self._change_walls(request, control.walls.add)),
            "remove_wall": ArmCommandRow(lambda request: self._change_walls(request, control.walls.remove)),
            "use_gravity_compensation": ArmCommandRow(self._use_gravity_compensation),
            "forward_kinematics": ArmCommandRow(self._forward),
            "local/forward_kinematics": ArmCommandRow(
                lambda request: _answer(pose_from_matrix(self._pose_of(request)).tolist())),
            "inverse_kinematics": ArmCommandRow(self._inverse),
            "actuator_to_joint_position": ArmCommandRow(self._actuator_to_joint),
            "crtk_version": ArmCommandRow(lambda _: CRTK_VERSION),
        }

    def _change_walls(self, request: Request, change: Callable[[Request], None]) -> str:
        change(request)
        self._control.place_walls()
        return self._control.walls.answer_later(request)

    def _set_ratios(self, v: float, a: float) -> None:
        control = self._control
        control.motion.set_ratio(v, a, control.now_ns)
        control.record.show_ratios(control.motion)

    def _set_base_frame(self, request: Request) -> str:
        control, values = self._control, request.values
        if self._base_from:
            raise CommandRefused(f"{self._base_from} gives the base frame of this arm")
        base = given_pose(values) if len(values) else None
        frame = self._frame_named(request.text, base)
        if frame != control.cartesian.frame:
            control.cartesian.name_frame(frame)
        control.set_base(base)
        return "base frame unknown: only local poses are valid" if base is None else ""

    def _frame_named(self, asked: str, base: Array | None) -> str:
        """The name of the reference frame for a base (4, 4), None: unknown; by default the present one.

        The frame of the base itself cannot be the reference in which that has a pose: a name stands for one frame.
        """
        cartesian, most = self._control.cartesian, self._control.cartesian.frame_bytes
        is_base = base is None or np.array_equal(base, np.eye(4))
        if len(asked.encode()) > most:
            raise CommandRefused(f"the name of a frame has at most {most} bytes")
        if asked == cartesian.local_frame and not is_base:
            raise CommandRefused(f"{asked} is the arm's base itself; give the reference frame another name")
        if not asked and cartesian.frame == cartesian.local_frame and not is_base:
            return f"{self._control.arm.name}_reference"[:most]
        return asked or cartesian.frame

    def _use_gravity_compensation(self, request: Request) -> None:
        gravity, wanted = self._control.gravity, switch(request)
        if wanted and not gravity.known:
            why = ("this arm has no gravity model; an arm file gives it one: gravity_compensation of a master, "
                   "kinematic_gc (other arms)")
            if self._has_reported_no_model:  # a teleoperation sends this each time it begins to follow
                raise CommandRefused(why)
            self._has_reported_no_model = True
            raise self._control.refusal(codes.COMMAND_REFUSED, request.name, why)
        gravity.used = wanted

    # queries; the answer is a JSON list of numbers

    def _forward(self, request: Request) -> str:
        pose = self._pose_of(request)
        self._control.cartesian.need_base()
        return _answer(pose_from_matrix(self._control.cartesian.to_reference(pose)).tolist())

    def _pose_of(self, request: Request) -> Array:
        """The pose (4, 4) after as many joints as there are values; the tip's if all are given."""
        kinematics, values = self._control.joints.kinematics, request.values
        if kinematics is None:
            raise CommandRefused("there is no instrument, so no tip")
        if not 0 < len(values) <= kinematics.n:
            raise CommandRefused(f"too many or no values; allowed: 1 to {kinematics.n}")
        joints = np.zeros(kinematics.n)
        joints[: len(values)] = values
        if len(values) == kinematics.n:
            return kinematics.fk(joints, np.eye(4))
        return kinematics.fk_to(joints, len(values))

    def _inverse(self, request: Request) -> str:
        """Arguments: seed (count,), then the pose of the tip in the arm's base; moves nothing."""
        joints, values = self._control.joints, request.values
        if joints.inverse is None:
            raise CommandRefused(joints.lacks_inverse)
        if len(values) != joints.count + POSE:
            raise CommandRefused(f"incorrect number of joints; {joints.count} and a pose are needed")
        if not joints.inverse.solve(given_pose(values[joints.count :]), values[: joints.count].copy()):
            raise CommandRefused(f"inverse kinematics failed: {joints.inverse.reason}")
        return _answer(joints.inverse.q.tolist())

    def _actuator_to_joint(self, request: Request) -> str:
        joints = self._control.joints
        if len(request.values) != joints.axes:
            raise CommandRefused(f"takes {joints.axes} values, {len(request.values)} were given")
        return _answer((joints.to_joint @ request.values).tolist())


def _answer(values: Sequence[float]) -> str:
    """To fifteen digits: a reply has 200 bytes."""
    return json.dumps([float(f"{value:.14g}") for value in values], separators=(",", ":"))
