"""Efforts of effort mode: joint efforts as given, or a wrench at the tip, converted to joint efforts every cycle.

Nonzero efforts end by themselves if the command is not repeated, because its sender may have died.
"""

from __future__ import annotations

from enum import Enum
from typing import Final

import numpy as np

from trocar.procs.arm.cartesian import Cartesian
from trocar.procs.arm.effort_limits import EffortLimits
from trocar.procs.kinematics.poses import Array, PoseError, given_rotation, rotation_vector
from trocar.procs.node.inputs import FOR_EVER_NS

KINDS: Final = 4  # P, D, bias, dead-band
COUNT: Final = 3 + 4 + 4 + 2 * KINDS * 6
"""Numbers of a servo_ci command, see `impedance_of`."""


class Law(Enum):
    """Source of the efforts."""

    JOINT = 0
    BODY = 1  # a wrench at the tip, in its axes or those of the reference frame
    SPATIAL = 2  # a wrench at the base's origin, in its axes
    IMPEDANCE = 3


class ImpedanceGains:
    """Cartesian impedance: a wrench that grows with the distance from a position and an orientation, and with speed.

    Each axis has a set of gains for each sign of the error: stiffness P, damping D, bias b and a dead-band by which the
    error shrinks: f = P · e + D · v + b. Gains are signed: a negative P pulls back. Forces are computed in the axes
    given with the position, torques in those of the orientation. All poses, twists and wrenches are in the reference
    frame.
    """

    def __init__(self, place: Array, force_axes: Array, orientation: Array, gains: Array) -> None:
        """`place` (3,) for forces, their axes (3, 3); `orientation` (3, 3) for torques, in its own axes.

        Gains (2, 4, 6): for positive and negative errors; P, D, bias, dead-band; x y z rx ry rz.
        """
        self._place, self._force_axes, self._orientation = place, force_axes, orientation
        self.gains = gains
        self._error, self._speed, self._wrench = np.zeros(6), np.zeros(6), np.zeros(6)

    def wrench(self, pose: Array, twist: Array) -> Array:
        """Force and torque (6,) for a measured pose (4, 4) and twist (6,); the next call overwrites it."""
        error, speed, forces, torques = self._error, self._speed, self._force_axes, self._orientation
        error[:3] = (pose[:3, 3] - self._place) @ forces  # rows: xᵀ · R = (Rᵀ · x)ᵀ
        error[3:] = rotation_vector(torques.T @ pose[:3, :3])
        speed[:3], speed[3:] = twist[:3] @ forces, twist[3:] @ torques
        p, d, bias, deadband = np.where(error > 0.0, self.gains[0], self.gains[1])
        shrunk = np.sign(error) * np.maximum(np.abs(error) - np.abs(deadband), 0.0)
        force = p * shrunk + d * speed + bias
        self._wrench[:3], self._wrench[3:] = forces @ force[:3], torques @ force[3:]
        return self._wrench


def impedance_of(values: Array, frame: Array | None = None) -> ImpedanceGains:
    """Gains from the numbers of a command; PoseError for too few numbers or an invalid quaternion.

    `frame`: pose (4, 4) of the command's frame, if that is not the reference frame.

    Position (3), quaternion of the forces' axes (4), orientation (4), then for positive errors P x y z rx ry rz, D,
    bias, dead-band in that order, then the same for negative errors.
    """
    if len(values) != COUNT:
        raise PoseError(f"servo_ci takes {COUNT} values, {len(values)} were given")
    place, axes, orientation = values[:3].copy(), given_rotation(values[3:7]), given_rotation(values[7:11])
    if frame is not None:
        turn = frame[:3, :3]
        place, axes, orientation = turn @ place + frame[:3, 3], turn @ axes, turn @ orientation
    return ImpedanceGains(place, axes, orientation, values[11:].reshape(2, KINDS, 6).copy())


class Efforts:
    """`effort` (size,): efforts of this cycle, within what the motors give; `clipped`: joints whose efforts were
    limited.
    """

    def __init__(self, cartesian: Cartesian, limits: EffortLimits, size: int, timeout_s: float) -> None:
        """`cartesian` is that of this cycle; `timeout_s` after the last command, efforts end; 0: never."""
        self._cartesian, self._limits = cartesian, limits
        self._timeout_ns = round(timeout_s * 1e9) or FOR_EVER_NS
        self._absolute = False
        self.wrench = np.zeros(6)
        self._turned = np.zeros(6)
        self._impedance: ImpedanceGains | None = None
        self.use(size)

    def use(self, size: int) -> None:
        """Use another size of joint vectors."""
        self._asked, self.effort = np.zeros((2, size))
        self.clipped = np.zeros(size, np.bool_)
        self.rest()

    # commands

    def rest(self) -> None:
        """Set all efforts to zero, the jaw's too."""
        self.law = Law.JOINT
        self._asked[...] = 0.0
        self._end_ns = self._timeout_at_ns = self._jaw_timeout_at_ns = FOR_EVER_NS

    def joint(self, efforts: Array, now_ns: int) -> None:
        """Set joint efforts (count,)."""
        self._ask(Law.JOINT, self.timeout_at(now_ns, efforts))
        self._asked[: len(efforts)] = efforts

    def jaw(self, effort: float, now_ns: int) -> None:
        """Set the effort of the jaw, independent of the other joints."""
        self._asked[-1] = effort
        self._jaw_timeout_at_ns = self.timeout_at(now_ns, self._asked[-1:])

    def body(self, wrench: Array, now_ns: int, *, absolute: bool, lasts_ns: int = FOR_EVER_NS) -> None:
        """Set a force and torque (6,) at the tip, for this long at most; `absolute`: in axes of the reference frame."""
        self._ask(Law.BODY, self.timeout_at(now_ns, wrench))
        self._absolute, self.wrench[...], self._end_ns = absolute, wrench, now_ns + lasts_ns

    def spatial(self, wrench: Array, now_ns: int) -> None:
        """Set a force and torque (6,) at the origin of the arm's base, in its axes."""
        self._ask(Law.SPATIAL, self.timeout_at(now_ns, wrench))
        self.wrench[...] = wrench

    def impede(self, impedance: ImpedanceGains, now_ns: int) -> None:
        """Act as this spring and damper."""
        self._ask(Law.IMPEDANCE, self.timeout_at(now_ns, impedance.gains))
        self._absolute, self._impedance = True, impedance

    def timeout_at(self, now_ns: int, numbers: Array) -> int:
        """When a command with these numbers must be repeated; all 0: never."""
        return now_ns + self._timeout_ns if numbers.any() else FOR_EVER_NS

    def _ask(self, law: Law, timeout_at_ns: int) -> None:
        self.law, self._timeout_at_ns, self._end_ns = law, timeout_at_ns, FOR_EVER_NS

    # the cycle

    def is_overdue(self, now_ns: int) -> bool:
        """Whether efforts other than 0 were not commanded again in time."""
        return now_ns >= self._timeout_at_ns or now_ns >= self._jaw_timeout_at_ns

    def step(self, now_ns: int) -> None:
        """Compute the efforts of this cycle from the measured tip."""
        if now_ns >= self._end_ns:
            self.wrench[...] = 0.0
            self._end_ns = self._timeout_at_ns = FOR_EVER_NS
        effort, cartesian = self.effort, self._cartesian
        effort[...] = self._asked
        if self.law is not Law.JOINT:
            n = cartesian.jacobian.shape[1]
            absolute = self._absolute and self.law is not Law.SPATIAL
            if cartesian.valid and (cartesian.base_known or not absolute):
                np.matmul(self._wrench_of(absolute), self._jacobian, out=effort[:n])  # rows: wᵀ · J = (Jᵀ · w)ᵀ
            else:
                effort[:n] = 0.0
        self.clipped = self._limits.clip(effort, together=self.law is not Law.JOINT)

    def feed(self, wrench: Array) -> Array:
        """Joint efforts (size,) for a wrench (6,) in axes of the reference frame; see `clipped`. The next `step` and
        `feed` overwrite them.
        """
        cartesian, n = self._cartesian, self._cartesian.jacobian.shape[1]
        self.effort[n:] = 0.0
        self.effort[:n] = (wrench.reshape(2, 3) @ cartesian.rotation).reshape(6) @ cartesian.jacobian
        self.clipped = self._limits.clip(self.effort, together=True)
        return self.effort

    @property
    def _jacobian(self) -> Array:
        return self._cartesian.spatial if self.law is Law.SPATIAL else self._cartesian.jacobian

    def _wrench_of(self, absolute: bool) -> Array:
        """The wrench (6,) of this cycle, at the tip in its axes or at the base."""
        cartesian, wrench = self._cartesian, self.wrench
        if self.law is Law.IMPEDANCE and self._impedance is not None:
            wrench = self._impedance.wrench(cartesian.to_reference(cartesian.tip), cartesian.twist)
        if not absolute:
            return wrench
        np.matmul(wrench.reshape(2, 3), cartesian.rotation, out=self._turned.reshape(2, 3))  # Rᵀ · w, in rows
        return self._turned
