"""Parts of arms: sets of joints, and the tip with its forces, its Jacobians, and its pose in the arm's base."""

from __future__ import annotations

import json

from numpy.typing import ArrayLike

from trocar.procs.kinematics.poses import matrix_from_pose
from trocar.tools.client.values import Array, JointState, Stamped, numbers, six_numbers
from trocar.tools.client.ways import CommandWay, RecordWay
from trocar.tools.output.errors import Problem


class Measured:
    """Where joints are."""

    def __init__(self, record: RecordWay, prefix: str) -> None:
        """`prefix` of the names of their views."""
        self._record, self._prefix = record, prefix

    def measured_js(self) -> tuple[JointState, int]:
        """Measured positions, velocities and efforts."""
        return self._record.joint_state(f"{self._prefix}measured_js")

    def measured_jp(self) -> Stamped:
        """Measured positions (n,)."""
        return self._record.part(f"{self._prefix}measured_js", "position")

    def measured_jv(self) -> Stamped:
        """Measured velocities (n,)."""
        return self._record.part(f"{self._prefix}measured_js", "velocity")

    def measured_jf(self) -> Stamped:
        """Measured efforts (n,)."""
        return self._record.part(f"{self._prefix}measured_js", "effort")

    def joint_names(self) -> list[str]:
        """Their names, in order."""
        return self._record.joint_names(f"{self._prefix}measured_js")


class Setpoint:
    """The last setpoint of the joint controller."""

    def __init__(self, record: RecordWay, prefix: str) -> None:
        """`prefix` of the names of their views."""
        self._record, self._prefix = record, prefix

    def setpoint_js(self) -> tuple[JointState, int]:
        """Its positions, velocities and efforts."""
        return self._record.joint_state(f"{self._prefix}setpoint_js")

    def setpoint_jp(self) -> Stamped:
        """Positions (n,)."""
        return self._record.part(f"{self._prefix}setpoint_js", "position")

    def setpoint_jv(self) -> Stamped:
        """Velocities (n,)."""
        return self._record.part(f"{self._prefix}setpoint_js", "velocity")

    def setpoint_jf(self) -> Stamped:
        """Efforts (n,)."""
        return self._record.part(f"{self._prefix}setpoint_js", "effort")


class Joints(Measured, Setpoint):
    """Measured values and setpoints of joints."""


class Frame:
    """Wrenches and Jacobian, either at the tip in its axes, or at the origin of the arm's base in the base's axes."""

    def __init__(self, record: RecordWay, remote: CommandWay, name: str) -> None:
        """`name` is body or spatial; made by `Arm`."""
        self._record, self._remote, self._name = record, remote, name

    def measured_cf(self) -> Stamped:
        """Force and torque (6,) equivalent to the measured efforts."""
        return self._record.part(f"{self._name}/measured_cf", "wrench")

    def jacobian(self) -> Stamped:
        """Jacobian (6, n), linear rows first."""
        return self._record.part(f"{self._name}/jacobian", "data")

    def servo_cf(self, wrench: ArrayLike, frame: str = "") -> None:
        """Apply this force and torque (6,), N and N·m, for `arm.effort_timeout_s` (0.1 s); zeros do not time out.

        Without a `frame`: of `body` at the tip, in the axes that `set_cf_orientation_absolute` selects; of `spatial` at
        the origin of the base.
        """
        self._remote.ask(f"{self._name}/servo_cf", six_numbers(wrench, "a wrench"), frame)


class Body(Frame):
    """Seen from the tip."""

    def set_cf_orientation_absolute(self, absolute: bool = True) -> None:
        """Interpret tip wrenches in axes of the reference frame from now on; False: in axes of the tip."""
        self._remote.ask("body/set_cf_orientation_absolute", (float(absolute),))


class Local:
    """Seen from the arm's base."""

    def __init__(self, record: RecordWay, remote: CommandWay) -> None:
        """Made by `Arm`."""
        self._record, self._remote = record, remote

    def measured_cp(self) -> Stamped:
        """Measured tip pose (4, 4)."""
        return self._record.pose("local/measured_cp")

    def setpoint_cp(self) -> Stamped:
        """Setpoint tip pose (4, 4)."""
        return self._record.pose("local/setpoint_cp")

    def measured_cv(self) -> Stamped:
        """Twist (6,) of the tip in its own axes, linear then angular."""
        return self._record.part("local/measured_cv", "twist")

    def forward_kinematics(self, position: ArrayLike) -> Array:
        """Pose (4, 4) of the tip at joint positions (n,); with fewer positions: of the frame after the last of them."""
        return asked_pose(self._remote, "local/forward_kinematics", position)


def asked(remote: CommandWay, command: str, values: ArrayLike) -> Array:
    """The numbers (n,) that a question is answered with; Refused with the reason, Problem when they are none."""
    text = remote.ask(command, numbers(values)).text
    try:
        answer = numbers(json.loads(text))
    except (ValueError, TypeError):
        raise Problem(f"{remote.instance} answered {command} with {text!r}, which are not numbers") from None
    return answer


def asked_pose(remote: CommandWay, command: str, values: ArrayLike) -> Array:
    """The pose (4, 4) that a question is answered with."""
    answer = asked(remote, command, values)
    if answer.shape != (7,):
        raise Problem(f"{remote.instance} answered {command} with {answer.size} numbers, which are not a pose")
    return matrix_from_pose(answer)
