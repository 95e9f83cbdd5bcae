"""What can be asked of an arm's motors: commands beyond that are clipped, and say so.

A motor gives its maximum current times its torque constant, both of its io file; joints get that through the coupling.
A kinematic file may rate a joint lower (ftmax): an instrument's wrist bears less than its motors give.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.arm.joints import JointSpace
from trocar.procs.document.system import Robot
from trocar.procs.kinematics.poses import Array

NO_MOTOR: Final = 1e-9  # N·m or N, of one that may have no current: it can be divided by


def motor_efforts(robot: Robot) -> tuple[float, ...]:
    """The largest effort of every actuator, N·m or N; none where the robot is kinematic."""
    if not all(actuator.effort_to_current for actuator in robot.actuators):
        return ()
    return tuple(abs(actuator.maximum_current / actuator.effort_to_current) for actuator in robot.actuators)


class EffortLimits:
    """Clips joint efforts (size,). `most`: what each joint can have at most, by all motors together; inf: not known."""

    def __init__(self, motors: Sequence[float], joints: JointSpace) -> None:
        """`motors`: the largest effort of every actuator; none: not known, the kinematic files count alone."""
        self._motors = np.maximum(motors, NO_MOTOR) if len(motors) else np.full(joints.axes, np.inf)
        self.use(joints)

    def use(self, joints: JointSpace) -> None:
        """Another joint space."""
        n = joints.size
        self._none, self._rated, self._map = joints.none, joints.rated, joints.to_joint
        self._drives = self._map != 0.0  # (size, axes)
        shares = np.multiply(np.abs(joints.to_actuator), self._motors[:, None], out=np.zeros(joints.to_actuator.shape),
                             where=joints.to_actuator != 0.0)
        self.most = np.minimum(shares.sum(axis=0), self._rated)
        self._load = np.zeros(n + joints.axes)
        self._of_joints, self._of_motors = self._load[:n], self._load[n:]

    def clip(self, effort: Array, *, together: bool) -> NDArray[np.bool_]:
        """Bring `effort` (size,) to what can be given, in place; returns the mask of joints that asked for more.

        `together`: all joints by the same factor, so that a wrench at the tip keeps its direction. Else one joint that
        asks for too much leaves those alone that share no motor with it: one of them may bear a weight.
        """
        np.abs(effort, out=self._of_joints)
        np.divide(self._of_joints, self._rated, out=self._of_joints)
        np.matmul(effort, self._map, out=self._of_motors)
        np.abs(self._of_motors, out=self._of_motors)
        np.divide(self._of_motors, self._motors, out=self._of_motors)
        if self._load.max() <= 1.0:
            return self._none
        drives_too_much = self._drives @ (self._of_motors > 1.0)
        outside: NDArray[np.bool_] = (self._of_joints > 1.0) | drives_too_much & (effort != 0.0)
        if together:
            effort /= self._load.max()
        else:
            np.clip(effort, -self._rated, self._rated, out=effort)
            effort /= self._shared(np.abs(effort @ self._map) / self._motors)
        return outside

    def _shared(self, load: Array) -> Array:
        """By what to divide each joint's effort (size,), for motors (axes,) that are to give so much of what they can.

        Joints that share a motor, or a motor with one that does, get the same.
        """
        over: Array = np.maximum(np.where(self._drives, load, 0.0).max(axis=1), 1.0)
        while True:
            spread = np.where(self._drives, over[:, None], 0.0).max(axis=0)  # to the motors
            wider = np.where(self._drives, spread, 0.0).max(axis=1)  # and back to the joints
            if (wider <= over).all():
                return over
            over = wider
