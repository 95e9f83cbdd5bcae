"""Mapping of a master's motion to a PSM: pose and jaw, and detection of a hand on the master.

Poses are (7,), x y z qx qy qz qw, in the arms' reference frames, which makes motion agree with the view; "first" values
are those of the last `rebase`. Angles in rad, lengths in m. Formulas as in dVRK 2.4, mtsTeleOperationPSM.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from trocar.procs.kinematics.poses import Array, conjugate, product, turned
from trocar.procs.tables.manifest import LATE_S
from trocar.procs.tables.operator_waits import GRIPPER, MOVING, OFF

Quaternion = tuple[float, float, float, float]

IDENTITY: Final = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
Y_AXIS: Final = (0.0, 1.0, 0.0)

TOGETHER: Final = 0.8  # share of the sum of both thresholds: smaller motions of both are presence as well
CAUGHT_UP: Final = math.radians(2.0)
NO_GRIPPER_JAW: Final = math.radians(45.0)  # jaw where the master has no gripper
MAX_LOST_S: Final = LATE_S  # a later cycle moves the jaw no further


def roll_between(master: Array, slave: Array) -> float:
    """The angle (0 to π) between the y axes of two tips, poses (7,): the roll of the master against the slave."""
    a, b, c = turned(master[3:].tolist(), Y_AXIS)
    d, e, f = turned(slave[3:].tolist(), Y_AXIS)
    return math.acos(max(-1.0, min(1.0, a * d + b * e + c * f)))


class PoseMapping:
    """The pose mapping. `goal` (7,) is the last goal for the slave; only `begin` makes it jump."""

    def __init__(self, scale: float, *, rotation_locked: bool = False, translation_locked: bool = False) -> None:
        """Call `begin` before `step`."""
        self.scale, self.rotation_locked, self.translation_locked = scale, rotation_locked, translation_locked
        self.goal: Array = np.array(IDENTITY)
        self.offset: Quaternion = IDENTITY[3:]
        """Rotation from the slave's orientation to the master's: R_masterᵀ · R_goal."""
        self.first_offset = self.offset
        self.first_master, self.first_slave = list(IDENTITY), list(IDENTITY)
        self.first_base: list[float] | None = None

    def begin(self, master: Array, slave: Array, base: Array | None = None) -> None:
        """Follow from here on: the master's measured pose, the slave's setpoint, its base frame if that moves."""
        self.first_master, self.first_slave = master.tolist(), slave.tolist()
        self.first_base = None if base is None else base.tolist()
        self.goal[...] = slave
        self.offset = self.first_offset = product(conjugate(self.first_master[3:]), self.first_slave[3:])

    def rebase(self, master: Array, base: Array | None = None) -> None:
        """The same from the last goal, so that a change of scale or locks moves nothing."""
        self.begin(master, self.goal, base)

    def step(self, master: Array, base: Array | None = None) -> Array:
        """The slave's goal for the master's measured pose; `base`: the slave's base frame now."""
        x, y, z, *turn = master.tolist()
        p, q, r, *first_turn = self.first_slave
        quaternion: Sequence[float] = first_turn
        if not self.translation_locked:
            scale, (a, b, c, *_) = self.scale, self.first_master
            p, q, r = p + scale * (x - a), q + scale * (y - b), r + scale * (z - c)
        if not self.rotation_locked:
            quaternion = product(turn, self.first_offset)
        if base is not None and self.first_base is not None:
            p, q, r, quaternion = _carried(self.first_base, base.tolist(), (p, q, r), quaternion)
        i, j, k, w = quaternion
        length = math.copysign(math.sqrt(i * i + j * j + k * k + w * w), w)
        unit = (i / length, j / length, k / length, w / length)
        self.goal[...] = (p, q, r, *unit)
        self.offset = product(conjugate(turn), unit)
        return self.goal

    def ahead(self, slave: Array, base: Array | None = None) -> tuple[float, float, float]:
        """How far the master is ahead of the slave's setpoint, in the axes in which the master is measured."""
        x, y, z = ((self.goal[:3] - slave[:3]) / self.scale).tolist()
        if base is not None and self.first_base is not None:
            x, y, z = turned(conjugate(self.first_base[3:]), turned(base[3:].tolist(), (x, y, z)))
        return x, y, z

    def velocity(self, twist: Array, *, linear: bool, angular: bool) -> Sequence[float]:
        """The slave's twist (6) for the master's: linear scaled, angular unchanged; zero unless `linear`, `angular`.

        Locked parts are zero.
        """
        x, y, z, a, b, c = twist.tolist()
        scale = self.scale if linear and not self.translation_locked else 0.0
        turn = 1.0 if angular and not self.rotation_locked else 0.0
        return scale * x, scale * y, scale * z, turn * a, turn * b, turn * c


def _carried(
    first: Sequence[float], base: Sequence[float], place: Sequence[float], quaternion: Sequence[float]
) -> tuple[float, float, float, Quaternion]:
    """A pose fixed in the reference frame, expressed in a base that has moved: base⁻¹ · first · pose."""
    back = conjugate(base[3:])
    x, y, z = turned(first[3:], place)
    x, y, z = turned(back, (first[0] + x - base[0], first[1] + y - base[1], first[2] + z - base[2]))
    return x, y, z, product(back, product(first[3:], quaternion))


class Presence:
    """Detects a hand on the master: its gripper or its roll has moved since the last `reset`."""

    def __init__(self, gripper_threshold: float, roll_threshold: float) -> None:
        """Ranges of motion that show a hand, rad; 0 for the gripper: always."""
        self._gripper_threshold, self._roll_threshold = gripper_threshold, roll_threshold
        self.is_active = False
        self.reset()

    def reset(self) -> None:
        """Forget the ranges, but not the result."""
        self._gripper_low, self._gripper_high = math.inf, -math.inf
        self.forget_roll()

    def forget_roll(self) -> None:
        """Forget the range of the roll."""
        self._roll_low, self._roll_high = math.inf, -math.inf

    def forget(self) -> None:
        """Forget the result, too: no hand is known to be on the master."""
        self.is_active = False
        self.reset()

    @property
    def gripper_range(self) -> float:
        """Range of the gripper's motion."""
        return max(0.0, self._gripper_high - self._gripper_low)

    @property
    def roll_range(self) -> float:
        """Range of the roll's motion."""
        return max(0.0, self._roll_high - self._roll_low)

    def look(self, gripper: float, roll: float) -> bool:
        """Add this cycle's angles (NaN: not known); once active, it stays active until `forget`."""
        if math.isfinite(gripper):
            self._gripper_low, self._gripper_high = min(self._gripper_low, gripper), max(self._gripper_high, gripper)
        if math.isfinite(roll):
            self._roll_low, self._roll_high = min(self._roll_low, roll), max(self._roll_high, roll)
        gripper_range, roll_range = self.gripper_range, self.roll_range
        if (gripper_range >= self._gripper_threshold or roll_range >= self._roll_threshold
                or gripper_range + roll_range > TOGETHER * (self._gripper_threshold + self._roll_threshold)):
            self.is_active = True
        return self.is_active


@dataclass(frozen=True, slots=True)
class Start:
    """Conditions for the start of following; angles in rad."""

    error: float
    tolerance: float
    is_active: bool
    is_moving: bool


def waiting_for(master: str, start: Start) -> str:
    """Why following does not start, for the operator; "": it may."""
    reasons = []
    if not start.error <= start.tolerance:
        reasons.append(f"{master} {math.degrees(start.error):.1f}° {OFF} {math.degrees(start.tolerance):g}°")
    if start.is_moving:
        reasons.append(f"{master} {MOVING}")
    if not start.is_active:
        reasons.append(f"pinch or twist {master}'s {GRIPPER}")
    return f"waiting: {'; '.join(reasons)}" if reasons else ""


class JawMapping:
    """The jaw's angle from the gripper's: jaw = k·g + o. A ghost of the gripper follows it at a limited rate.

    A jaw whose upper limit is 0 does not open (k = 0): it keeps its angle.
    """

    def __init__(self, gripper_zero: float, gripper_max: float, rate: float, rate_after_clutch: float) -> None:
        """Gripper angles for a jaw at 0 and fully open (rad, not the same); rates of the ghost, rad/s."""
        self._zero, self._max = gripper_zero, gripper_max
        self.rate, self.slow_rate = rate, rate_after_clutch
        self.ghost = 0.0
        self.is_catching_up, self.has_gripper = True, False
        self.begun = 0.0
        self.use(0.0, gripper_max)

    def use(self, lower: float, upper: float) -> None:
        """Set the range of the attached jaw, rad."""
        self.lower = lower
        self.factor = upper / (self._max - self._zero)
        self.offset = -self._zero * self.factor

    def jaw_of(self, gripper: float) -> float:
        """The jaw's angle for a gripper angle."""
        return self.factor * gripper + self.offset

    def begin(self, jaw: float) -> None:
        """Continue from the jaw's setpoint, slowly until the jaw has caught up with the gripper."""
        self.begun = jaw
        if self.factor:
            self.ghost = (jaw - self.offset) / self.factor
        self.is_catching_up, self.has_gripper = True, False

    def step(self, gripper: float, passed_s: float) -> float:
        """The jaw's angle after `passed_s`; `gripper` NaN: the master has none, or its angle is not known any more.

        Without a gripper the jaw goes to NO_GRIPPER_JAW; with an unknown angle it stays.
        """
        if not self.factor:
            return self.begun
        if math.isfinite(gripper):
            self.has_gripper = True
        else:
            gripper = self.ghost if self.has_gripper else (NO_GRIPPER_JAW - self.offset) / self.factor
        if abs(gripper - self.ghost) < CAUGHT_UP:
            self.is_catching_up = False
        most = (self.slow_rate if self.is_catching_up else self.rate) * max(0.0, min(passed_s, MAX_LOST_S))
        self.ghost += max(-most, min(most, gripper - self.ghost))
        jaw = self.jaw_of(self.ghost)
        if jaw < self.lower:
            jaw = self.lower
            self.ghost = (jaw - self.offset) / self.factor
        return jaw
