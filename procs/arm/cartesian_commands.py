"""Commands of the tip. Poses are x y z, quaternion x y z w.

A command's text names the frame of its numbers: the arm's base, or the reference frame, which is the default.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np

from trocar.procs.arm.arm_commands import ArmCommandRow, Ready, Table
from trocar.procs.arm.control import Control
from trocar.procs.arm.efforts import impedance_of
from trocar.procs.arm.motion import Mode, Space
from trocar.procs.arm.reach import Guard, Reach
from trocar.procs.arm.reports import REPORT_NS
from trocar.procs.kinematics.inverse.solver import InverseSolver
from trocar.procs.kinematics.poses import Array, given_pose
from trocar.procs.node.inputs import FOR_EVER_NS
from trocar.procs.node.requests import CommandRefused, switch
from trocar.procs.tables import codes
from trocar.shm.mailbox.received import Request

POSE: Final = 7
TWIST: Final = 6
MAX_S: Final = 3600.0
MAX_FORCE: Final = 1000.0  # N, ten times what the strongest joint gives
MAX_TORQUE: Final = 100.0  # N·m, the smaller number
ERROR_EVERY_NS: Final = 1_000_000_000

Safe = Callable[[Array], str]
"""Why Cartesian control may not begin at joints (size,); "": it may."""


class CartesianCommands:
    """servo and move in poses and increments, wrenches, impedance."""

    def __init__(self, control: Control, safe: Safe, guard: Guard | None = None) -> None:
        self._control, self._safe, self._guard = control, safe, guard
        self._reach = Reach(control, guard)
        tip = Ready.CARTESIAN
        self.table: Table = {
            "servo_cp": ArmCommandRow(self._servo_cp, tip),
            "servo_cr": ArmCommandRow(self._servo_cr, tip),
            "servo_cs": ArmCommandRow(self._servo_cs, tip),
            "move_cp": ArmCommandRow(self._move_cp, tip),
            "move_cr": ArmCommandRow(self._move_cr, tip),
            "servo_cf": ArmCommandRow(self._body_servo_cf, tip),
            "body/servo_cf": ArmCommandRow(self._body_servo_cf, tip),
            "spatial/servo_cf": ArmCommandRow(self._spatial_servo_cf, tip),
            "servo_ci": ArmCommandRow(self._servo_ci, tip),
            "body/set_cf_orientation_absolute": ArmCommandRow(self._set_absolute),
        }

    def enter(self, name: str) -> None:
        """CommandRefused unless Cartesian control may begin, or is active already."""
        control = self._control
        if control.motion.space is Space.CARTESIAN:
            return
        why = self._safe(control.here)
        if why:
            raise control.refusal(codes.NOT_INSERTED, name, why, REPORT_NS)

    def _is_local(self, request: Request) -> bool:
        """Whether a command is in the frame of the arm's base, see `Cartesian.is_local`."""
        try:
            return self._control.cartesian.is_local(request.text)
        except CommandRefused as error:
            raise self._control.refusal(codes.UNKNOWN_FRAME, request.name, str(error), REPORT_NS) from None

    # poses

    def _pose(self, request: Request) -> Array:
        """The pose (4, 4) of a command, in the arm's base."""
        pose = given_pose(request.values[:POSE])
        if self._is_local(request):
            return pose
        self._control.cartesian.need_base()
        return self._control.cartesian.to_local(pose)

    def _turned(self, request: Request, values: Array) -> Array:
        """A twist or wrench (6,) of a command, in axes of the reference frame."""
        return self._control.cartesian.turned(values) if self._is_local(request) else values

    def _relative(self, request: Request, joints: Array) -> Array:
        """The tip at `joints`, shifted and turned about itself in axes of the command's frame, in the base."""
        control = self._control
        kinematics, cartesian = control.joints.kinematics, control.cartesian
        if kinematics is None:
            raise CommandRefused("there is no instrument, so no tip")
        change, is_local = given_pose(request.values), self._is_local(request)
        pose = kinematics.fk(joints, np.eye(4))
        if not is_local:
            cartesian.need_base()
            pose = cartesian.to_reference(pose).copy()
        pose[:3, 3] += change[:3, 3]
        pose[:3, :3] = change[:3, :3] @ pose[:3, :3]
        return pose if is_local else cartesian.to_local(pose)

    def _inverse(self) -> InverseSolver:
        inverse = self._control.joints.inverse
        if inverse is None:
            raise CommandRefused(self._control.joints.lacks_inverse)
        return inverse

    def _solve(self, name: str, goal: Array, seed: Array) -> Array:
        """Joints (count,) for a goal in the arm's base, close to the seed; CommandRefused if there are none."""
        control, inverse = self._control, self._inverse()
        if not inverse.solve(goal, seed):
            reason = f"unable to solve inverse kinematics ({inverse.reason})"
            raise control.refusal(codes.INVERSE_KINEMATICS, name, reason, ERROR_EVERY_NS)
        if self._guard is not None:
            self._guard(inverse.q, seed)
        return inverse.q

    def _follow(self, name: str, goal: Array, velocity: Array | None = None) -> str:
        control, inverse = self._control, self._inverse()
        joints = control.take_goal()
        own = joints[: control.joints.count]
        found, why = self._reach.find(name, inverse, goal, own)
        own[...] = found
        if not why:
            return control.follow(name, Space.CARTESIAN, velocity)
        control.report(codes.AT_LIMIT, f"{name}: at its limit: {why}", REPORT_NS)
        control.follow(name, Space.CARTESIAN)
        return f"at its limit: {why}"

    def _servo_cp(self, request: Request) -> str:
        self.enter(request.name)
        control, values = self._control, request.values
        given, twist = (values, None) if len(values) == POSE else (values[:POSE], values[POSE:])
        is_local = control.cartesian.frames.get(request.text)
        is_near = is_local is not None and self._reach.is_near(given, is_local)
        goal = None if is_near else self._pose(request)
        velocity = None if twist is None else control.cartesian.rates(self._turned(request, twist))
        if goal is not None:
            return self._follow(request.name, goal, velocity)
        return control.follow(request.name, Space.CARTESIAN, velocity)

    def _servo_cr(self, request: Request) -> str:
        self.enter(request.name)
        control = self._control
        n = control.joints.count
        base = control.target if control.motion.is_pending(control.now_ns) else control.io.setpoint
        return self._follow(request.name, self._relative(request, base[:n]))

    def _servo_cs(self, request: Request) -> str:
        """Pose, twist, wrench, then a flag for each that is used (1 or 0)."""
        values = request.values
        pose, twist, wrench = (bool(flag) for flag in values[POSE + 2 * TWIST :])
        self.enter(request.name)
        if twist and not pose:
            raise CommandRefused("a twist needs a pose")
        force = self._turned(request, values[POSE + TWIST : POSE + 2 * TWIST]) if wrench else np.zeros(TWIST)
        if not pose:
            return self._push_body(force, absolute=wrench)
        turned = self._turned(request, values[POSE : POSE + TWIST]) if twist else None
        velocity = self._control.cartesian.rates(turned) if turned is not None else None
        text = self._follow(request.name, self._pose(request), velocity)
        if wrench:
            _check_wrench(force)
            text = self._control.feed(force) or text
        return text

    def _move_cp(self, request: Request) -> str:
        self.enter(request.name)
        return self._move(request, self._pose(request))

    def _move_cr(self, request: Request) -> str:
        self.enter(request.name)
        control = self._control
        return self._move(request, self._relative(request, control.target[: control.joints.count]))

    def _move(self, request: Request, goal: Array) -> str:
        control = self._control
        n = control.joints.count
        seed = control.here[:n].copy()
        try:
            joints = self._solve(request.name, goal, seed)
        except CommandRefused:
            if control.motion.moving:
                control.stop(control.here, Mode.POSITION, "replaced by a move that cannot be carried out")
            raise
        control.take_target()[:n] = joints
        return control.move(request, Space.CARTESIAN)

    # wrenches

    def _push_body(self, wrench: Array, *, absolute: bool, lasts_ns: int = FOR_EVER_NS) -> str:
        """`absolute`: the wrench is in axes of the reference frame."""
        control = self._control
        _check_wrench(wrench)
        if absolute:
            control.cartesian.need_base()
        control.push(Space.CARTESIAN).body(wrench, control.now_ns, absolute=absolute, lasts_ns=lasts_ns)
        return control.pushed()

    def _body_servo_cf(self, request: Request) -> str:
        """A seventh value limits the duration, in s, if shorter than the timeout for efforts; an eighth selects the
        axes: 1 the reference frame's, 0 the tip's. So does a frame; that of the tip, as published, leaves them as set.
        """
        self.enter(request.name)
        values, lasts_ns, absolute = request.values, FOR_EVER_NS, self._control.cartesian.absolute
        if len(values) > TWIST:
            if not 0.0 < values[TWIST] <= MAX_S:
                raise CommandRefused(f"it may last up to {MAX_S:g} s, not {values[TWIST]:g}")
            lasts_ns = round(values[TWIST] * 1e9)
        if len(values) > TWIST + 1:
            absolute = bool(values[TWIST + 1])
        wrench = values[:TWIST]
        if request.text not in ("", self._control.arm.name):
            wrench, absolute = self._turned(request, wrench), True
        return self._push_body(wrench, absolute=absolute, lasts_ns=lasts_ns)

    def _spatial_servo_cf(self, request: Request) -> str:
        self.enter(request.name)
        control, wrench = self._control, request.values
        if request.text and not self._is_local(request):
            control.cartesian.need_base()
            wrench = control.cartesian.wrench_at_base(wrench)
        _check_wrench(wrench)
        control.push(Space.CARTESIAN).spatial(wrench, control.now_ns)
        return control.pushed()

    def _servo_ci(self, request: Request) -> str:
        self.enter(request.name)
        control = self._control
        control.cartesian.need_base()
        impedance = impedance_of(request.values, control.cartesian.base if self._is_local(request) else None)
        control.push(Space.CARTESIAN).impede(impedance, control.now_ns)
        return control.pushed()

    def _set_absolute(self, request: Request) -> None:
        self._control.cartesian.absolute = switch(request)


def _check_wrench(wrench: Array) -> None:
    """CommandRefused for a wrench that no arm can exert: a wrong unit, or a wrong index."""
    if wrench.dot(wrench) <= MAX_TORQUE**2:
        return
    force, torque = float(np.abs(wrench[:3]).max()), float(np.abs(wrench[3:]).max())
    if force > MAX_FORCE or torque > MAX_TORQUE:
        raise CommandRefused(f"{force:g} N and {torque:g} N·m; allowed: {MAX_FORCE:g} N and {MAX_TORQUE:g} N·m")
