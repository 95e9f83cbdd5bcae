"""Bounds of efforts: what motors can give (`EffortLimits`), and in effort mode speeds and walls (`EffortGuard`).

A motor gives its maximum current times its torque constant, both from its io file; the coupling converts that to
joints. A kinematic file may rate a joint lower (ftmax): an instrument's wrist withstands less than its motors give.
Commands beyond these bounds are clipped and reported.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.arm.joints import JointSpace
from trocar.procs.arm.motion import Motion
from trocar.procs.document.system import Robot
from trocar.procs.kinematics.poses import Array
from trocar.procs.native.arm_fields import LIMITS
from trocar.procs.native.library import chosen

NO_MOTOR: Final = 1e-9  # N·m or N, for a motor without current: avoids division by 0
FREE_SHARE: Final = 0.5  # of the speed limit, up to which the full effort is available
SPRING: Final = 0.3  # of the largest effort, for the wall's push at the limit: soft for hands
MAX_ZONE: Final = 0.2  # of a joint's range
TINY: Final = 1e-9  # rad or m
FREE: Final = np.array([[np.inf], [-np.inf]])


def motor_efforts(robot: Robot) -> tuple[float, ...]:
    """The largest effort of every actuator, N·m or N; empty for a kinematic robot."""
    if not all(actuator.effort_to_current for actuator in robot.actuators):
        return ()
    return tuple(abs(actuator.maximum_current / actuator.effort_to_current) for actuator in robot.actuators)


class EffortLimits:
    """Clips joint efforts (size,). `most`: largest effort of each joint with all motors together; inf: not known."""

    def __init__(self, motors: Sequence[float], joints: JointSpace) -> None:
        """`motors`: the largest effort of every actuator; empty: not known, only the kinematic files count."""
        self.motors = np.maximum(motors, NO_MOTOR) if len(motors) else np.full(joints.axes, np.inf)
        self.use(joints)

    def use(self, joints: JointSpace) -> None:
        """Use another joint space."""
        n = joints.size
        self._none, self.rated, self.map = joints.none, joints.rated, np.ascontiguousarray(joints.to_joint)
        self.size, self.axes = n, joints.axes
        self._drives = self.map != 0.0  # (size, axes)
        shares = np.multiply(np.abs(joints.to_actuator), self.motors[:, None], out=np.zeros(joints.to_actuator.shape),
                             where=joints.to_actuator != 0.0)
        self.most = np.minimum(shares.sum(axis=0), self.rated)
        self._load = np.zeros(n + joints.axes)
        self.of_joints, self.of_motors = self._load[:n], self._load[n:]
        self.wanted = np.zeros(n)
        (self._bear,) = chosen(LIMITS, self, "by_numpy_")

    def clip(self, effort: Array, *, together: bool) -> NDArray[np.bool_]:
        """Clip `effort` (size,) to the possible values, in place; returns the mask of clipped joints.

        `together`: scale all joints by the same factor, so that a wrench at the tip keeps its direction. Else an
        excessive joint effort does not affect joints that share no motor with it: one of them may carry a weight.
        """
        self.wanted[...] = effort
        if self._bear():
            return self._none
        drives_too_much = self._drives @ (self.of_motors > 1.0)
        outside: NDArray[np.bool_] = (self.of_joints > 1.0) | drives_too_much & (effort != 0.0)
        if together:
            effort /= self._load.max()
        else:
            np.clip(effort, -self.rated, self.rated, out=effort)
            effort /= self._shared(np.abs(effort @ self.map) / self.motors)
        return outside

    # the reference of the native library

    def by_numpy_bear(self) -> int:
        """Whether no joint and no motor has more than it bears; fills both loads for the `wanted` efforts."""
        np.abs(self.wanted, out=self.of_joints)
        np.divide(self.of_joints, self.rated, out=self.of_joints)
        np.matmul(self.wanted, self.map, out=self.of_motors)
        np.abs(self.of_motors, out=self.of_motors)
        np.divide(self.of_motors, self.motors, out=self.of_motors)
        return int(self._load.max() <= 1.0)

    def _shared(self, load: Array) -> Array:
        """Divisor for each joint's effort (size,), for a `load` of the motors (axes,) as a multiple of their largest
        efforts.

        Joints that share a motor, or a motor with one that does, get the same divisor.
        """
        over: Array = np.maximum(np.where(self._drives, load, 0.0).max(axis=1), 1.0)
        while True:
            spread = np.where(self._drives, over[:, None], 0.0).max(axis=0)  # to the motors
            wider = np.where(self._drives, spread, 0.0).max(axis=1)  # and back to the joints
            if (wider <= over).all():
                return over
            over = wider


class EffortGuard:
    """Bounds the efforts of a cycle by a speed limit, and by a soft wall before each joint's limits.

    The driving effort of a joint is at most D · (v - speed): a joint under constant effort reaches its speed limit and
    stays there; a joint that is pushed faster from outside is braked. In the zone before a position limit the permitted
    outward speed shrinks to 0, so that a joint comes to rest before the limit, and a spring pushes it back. All of that
    is one-sided and continuous, and D is small: at half the speed limit a joint still has its whole effort, and the
    damping is a fraction of the joint controller's. A slow joint away from its limits is not affected.

    Call `begin` at the start of effort mode.
    """

    def __init__(self, speed_ratio: float, zone_ratio: float) -> None:
        """Factors on speeds and zones of the table (`trocar.procs.tables.arm_types`); 0: off."""
        self._has_speed, self._has_zone = bool(speed_ratio), bool(zone_ratio)
        self._speed_ratio, self._zone_ratio = speed_ratio or 1.0, zone_ratio

    def use(self, joints: JointSpace, most: Array) -> None:
        """Use another joint space; `most` (size,) are the largest efforts, inf where unknown: not guarded."""
        n, known = joints.size, np.isfinite(most)
        self._unknown = None if known.all() else ~known
        self._most = np.where(known, most, 0.0)
        self._damping = self._most / (FREE_SHARE * joints.effort_speed)
        zone = np.minimum(joints.effort_zone * self._zone_ratio, MAX_ZONE * (joints.upper - joints.lower))
        per_zone = 1.0 / np.maximum(zone, TINY)
        # rows (2, size): upwards, downwards; the rest of the zone, and its maximum since effort mode began
        self._left, self._seen, self._part = np.ones((2, n)), np.zeros((2, n)), np.zeros((2, n))
        self._per_zone = np.array([-per_zone, per_zone])
        self._limit = np.array([joints.upper * per_zone, -joints.lower * per_zone])
        self._driving = np.array([[1.0], [-1.0]]) * self._damping * joints.effort_speed * self._speed_ratio
        self._spring = np.array([[-1.0], [1.0]]) * SPRING * self._most
        self._bound = np.zeros((2, n))
        self._upper, self._lower = self._bound
        self._up, self._down = self._part
        self._effort, self._braking = np.zeros((2, n))
        self._least = -self._most

    def begin(self) -> None:
        """Effort mode begins: a joint inside its zone may stay there, and is pushed back only if it goes further."""
        self._seen[...] = 0.0

    def step(self, position: Array, velocity: Array, motion: Motion) -> None:
        """Bound `motion.effort` at these joint positions and velocities (size,)."""
        left, bound, part, guarded = self._left, self._bound, self._part, self._effort
        if self._has_zone:
            np.multiply(self._per_zone, position, out=left)
            np.add(left, self._limit, out=left)
            np.minimum(left, 1.0, out=left)
            np.maximum(left, 0.0, out=left)
            np.maximum(self._seen, left, out=self._seen)
        np.multiply(self._driving, left, out=bound)
        np.multiply(self._damping, velocity, out=self._braking)
        np.subtract(bound, self._braking, out=bound)
        if not self._has_speed:
            np.copyto(bound, FREE, where=left == 1.0)
        np.minimum(motion.effort, self._upper, out=guarded)
        np.maximum(guarded, self._lower, out=guarded)
        np.minimum(guarded, self._most, out=guarded)
        np.maximum(guarded, self._least, out=guarded)
        if self._has_zone:
            np.subtract(self._seen, left, out=part)
            np.multiply(part, self._spring, out=part)
            np.add(guarded, self._up, out=guarded)
            np.add(guarded, self._down, out=guarded)
        if self._unknown is not None:
            np.copyto(guarded, motion.effort, where=self._unknown)
        np.copyto(motion.effort, guarded, where=motion.in_effort)
