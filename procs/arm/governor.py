"""The governor limits all position setpoints of an arm in each cycle, before io, whatever their source.

A setpoint goes to its target at no more than the joint's largest speed, and speeds up by no more than its largest
acceleration (`servo` in procs/tables/arm_types.py) relative to its recent speed. A target within both is reached in
this very cycle, so a stream that the arm can follow passes unchanged. On the way to a distant target a joint brakes in
time; it never goes beyond its target, even if a stream stops at once. Moves, which have their own smaller bounds, and
efforts are not governed.

    low, high   = rate reduced to 0, or increased by acceleration · dt, within ± speed
    velocity    = (target − setpoint) / dt                   where that lies between low and high: the target is reached
                  braking speed, brought between the two     elsewhere; (√(¼ + 2d / (a·dt²)) − ½) · a·dt stops after d
    rate       := velocity, or slower than it was by a quarter of acceleration · dt, if that is faster
    setpoint   += velocity · dt

`rate` falls slowly, because goals of a stream do not come in every cycle: at 1500 Hz, a stream of 1000 Hz skips every
third cycle.

For a target that is not a number, the joint stops.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from typing import TYPE_CHECKING, Final

import numpy as np

from trocar.procs.kinematics.poses import Array
from trocar.procs.native.arm_fields import GOVERNOR
from trocar.procs.native.library import chosen

if TYPE_CHECKING:
    from trocar.procs.arm.motion import Motion

MAX_LAG_S: Final = 0.1
"""A stream whose target is further away than a joint moves in this time at its largest speed has jumped, and ends."""
LATE_S: Final = 0.02
"""A stream is reported as limited if its last goal is still this far away when the next one comes."""
MAX_STEP_NS: Final = 5_000_000  # after a pause of this process a setpoint continues from its place, without catching up

JOINT_ROWS: Final = ("goal", "target", "asked", "velocity", "feed", "speed", "acceleration", "lower", "upper", "rate",
                     "behind")
"""The arrays (size,) of a governor."""


class Governor:
    """Moves `goal` towards `target`. `behind` (size,): distance as seconds at the largest speed, `most`: their maximum.

    It works on arrays (size,) of a motion, which stay the same objects. `lower`, `upper` (size,): limits of the joints;
    `is_inside`: the last goal in `asked` is within them.

    `clip` is for walls: from the last setpoint, the one of this cycle, which it may change in place, the least and
    largest change of each joint (2, size) in it, and its time in s, it returns whether it changed it; of the newest
    cycle, `clipped`. `slow`: from the last setpoint, the one of this cycle, and its time in s, how much of that step a
    move may take before another arm; `meets`: whether `clip` is to be called, which takes longer.
    """

    def __init__(self, of: Motion, speed: Array, acceleration: Array, lower: Array, upper: Array) -> None:
        self.goal, self.target, self.asked = of.goal, of.target, of.asked
        self.velocity, self.feed = of.velocity, of.feed_velocity
        self.speed, self.acceleration = speed, acceleration
        self.lower, self.upper, self.is_inside = lower, upper, True
        self.size = len(speed)
        self.rate, self.behind, self.most = np.zeros(self.size), np.zeros(self.size), np.zeros(1)
        self.clip: Callable[[Array, Array, Array, float], bool] | None = None
        self.meets: Callable[[Array, Array, float], bool] = lambda before, goal, seconds: True
        self.slow: Callable[[Array, Array, float], float] | None = None
        self.clipped = False
        self._advance, self._measure = chosen(GOVERNOR, self)

    def of_last(self) -> Governor:
        """The last joint's part of this governor, on the same arrays, without walls."""
        part = copy(self)
        for name in JOINT_ROWS:
            setattr(part, name, getattr(self, name)[-1:])
        part.size, part.clip = 1, None
        part._advance, part._measure = chosen(GOVERNOR, part)
        return part

    def start(self, rate: Array | float) -> None:
        """Start from rest, or at the speed of the motion that ends."""
        self.rate[...] = np.minimum(np.maximum(rate, -self.speed), self.speed)
        self.most[0] = 0.0

    def step(self, passed_ns: int, *, has_feed: bool) -> bool:
        """One cycle, this long after the previous one; returns whether the next one has work to do.

        `has_feed`: the velocities that came with the target are passed on as well, within the largest speeds.
        """
        if not 0 < passed_ns <= MAX_STEP_NS:
            passed_ns = MAX_STEP_NS if passed_ns > 0 else 1
        dt = passed_ns * 1e-9
        if self.clip is None:
            return self._advance(dt, has_feed) != 0
        before, rate = self.goal.copy(), self.rate.copy()
        moves = bool(self._advance(dt, has_feed))
        self.clipped = False
        if self.meets(before, self.goal, dt):
            advanced, gain = self.goal.copy(), self.acceleration * dt
            low = np.maximum(np.minimum(rate, 0.0) - gain, -self.speed)
            high = np.minimum(np.maximum(rate, 0.0) + gain, self.speed)
            self.clipped = self.clip(before, self.goal, np.stack((low, high)) * dt, dt)
        if self.clipped:
            changed, rate = self.goal != advanced, (self.goal - before) / dt
            np.copyto(self.rate, rate, where=changed)
            if has_feed:
                np.copyto(self.velocity, rate, where=changed)
        return moves or self.clipped

    def lag(self) -> tuple[float, int]:
        """Distance to `asked`, in s at the largest speed, and its joint."""
        worst = self._measure()
        self.is_inside = worst >= 0
        return self.most.item(), worst if worst >= 0 else ~worst

    # the reference of the native library

    def advance(self, dt: float, has_feed: int) -> int:
        """Compute setpoint, rate and velocities of this cycle; returns whether any joint moves."""
        with np.errstate(over="ignore", invalid="ignore"):
            return self._advanced(dt, has_feed)

    def _advanced(self, dt: float, has_feed: int) -> int:
        speed, rate, gain = self.speed, self.rate, self.acceleration * dt
        distance = self.target - self.goal
        is_finite = np.isfinite(distance)
        distance = np.where(is_finite, distance, 0.0)
        direct = distance / dt
        low = np.maximum(np.minimum(rate, 0.0) - gain, -speed)
        high = np.minimum(np.maximum(rate, 0.0) + gain, speed)
        braking = (np.sqrt(0.25 + 2.0 * np.abs(distance) / (gain * dt)) - 0.5) * gain
        wanted = np.minimum(np.maximum(np.copysign(braking, distance), low), high)
        is_direct = (low <= direct) & (direct <= high)
        velocity = np.where(is_direct, direct, wanted)
        slower = np.copysign(np.maximum(np.abs(rate) - 0.25 * gain, 0.0), rate)
        self.rate[...] = np.where((velocity * rate < 0.0) | (np.abs(velocity) >= np.abs(slower)), velocity, slower)
        self.goal[...] = np.where(is_direct & is_finite, self.target, self.goal + velocity * dt)
        self._show(self.target)
        if has_feed:
            self.velocity[...] = np.minimum(np.maximum(self.feed, -speed), speed)
        return int(bool((~is_direct).any() or self.rate.any()))

    def measure(self) -> int:
        """Fill `behind` and `most` for `asked`; returns the joint of `most`, complemented if a joint is outside its
        limits.
        """
        self._show(self.asked)
        worst = int(self.behind.argmax())
        return worst if ((self.lower <= self.asked) & (self.asked <= self.upper)).all() else ~worst

    def _show(self, target: Array) -> None:
        with np.errstate(invalid="ignore"):  # inf - inf
            behind = np.abs(target - self.goal) / self.speed
        self.behind[...] = np.where(np.isnan(behind), np.inf, behind)
        self.most[0] = self.behind.max(initial=0.0)
