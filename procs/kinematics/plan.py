"""Plans of several joints to a goal at rest: all end at the same time, along a straight line if the start allows it.

The start allows it if distances and velocities of all joints are in proportion, within rounding.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from trocar.procs.kinematics.pieces import Pieces, pieces
from trocar.procs.kinematics.stroke import Profile, lasting, quickest

ROUNDING: Final = 2.0**-52
"""How far a start may be from a straight line."""
IN_LIMITS: Final = 1e-12
"""How far a straight line may be beyond limits."""
IN_LINE: Final = 1e-8
"""How far joints may be from a straight line after braking."""


class Joint:
    """A joint of a plan: it brakes if it is too fast, then has its profile."""

    def __init__(self, position: float, velocity: float, goal: float, v_max: float, a_max: float) -> None:
        """Plan the quickest motion."""
        self._start, self._v_max, self._a_max = (position, velocity), v_max, a_max
        self.line = goal - position, velocity
        """Distance and velocity at the start."""
        self._brake_s = max(0.0, abs(velocity) - v_max) / a_max
        self._brake = -math.copysign(a_max, velocity)
        self._distance = goal - position - self._brake_s * velocity - self._brake_s * self._brake_s * self._brake / 2.0
        self._velocity = min(max(velocity, -v_max), v_max)
        self._profile = self._quickest = quickest(self._distance, self._velocity, v_max, a_max)
        self.end_s = self._brake_s + self._quickest.duration_s
        """When it can end at the earliest."""

    def follows(self, leader: Joint, share: float) -> Profile | None:
        """The profile that does `share` of the leader's motion; None if it cannot."""
        profile = leader._quickest.scaled(share)
        if self is not leader and (
                abs(self._brake_s - leader._brake_s) > IN_LINE
                or abs(self._distance - share * leader._distance) > IN_LINE
                or abs(self._velocity - share * leader._velocity) > IN_LINE
                or abs(profile.ramp) > self._a_max + IN_LIMITS
                or abs(self._velocity + profile.ramp_s * profile.ramp) > self._v_max + IN_LIMITS):
            return None
        return profile

    def ends_at(self, end_s: float) -> Profile:
        """The profile that ends then, which must not be earlier than `end_s` of the joint."""
        duration_s = end_s - self._brake_s
        if duration_s - self._quickest.duration_s < 2.0 * ROUNDING:
            return self._quickest
        return lasting(duration_s, self._distance, self._velocity, self._a_max)

    def pieces(self, profile: Profile) -> Pieces:
        """Its motion with this profile."""
        ramp_s, coast_s, stop_s, ramp, stop = profile
        return pieces(*self._start, ((self._brake_s, self._brake, 0.0), (ramp_s, ramp, 0.0), (coast_s, 0.0, 0.0),
                                     (stop_s, stop, 0.0)))


def synchronized(joints: Sequence[Joint]) -> tuple[float, tuple[Pieces, ...]]:
    """The duration, s, and the motions that all end then, with the slowest joint; infinity if it is too far away."""
    ends_s = [joint.end_s for joint in joints]
    if not all(map(math.isfinite, ends_s)):
        return math.inf, ()
    end_s, slowest = max(zip(ends_s, range(len(joints)), strict=True))
    shares = _shares([joint.line for joint in joints], slowest)
    profiles = [joint.follows(joints[slowest], share) for joint, share in zip(joints, shares, strict=False)]
    if not profiles or None in profiles:
        profiles = [joint.ends_at(end_s) for joint in joints]
    return end_s, tuple([joint.pieces(profile) for joint, profile in zip(joints, profiles, strict=True) if profile])


def _shares(lines: Sequence[tuple[float, float]], slowest: int) -> list[float]:
    """What each joint does of the motion of the slowest one, if distances and velocities are on a straight line."""
    first = next((line for line in lines if max(abs(line[0]), abs(line[1])) > ROUNDING), None)
    if first is None:
        return []
    along = 0 if abs(first[0]) > ROUNDING else 1
    if not lines[slowest][along] or any(abs(line[i] - first[i] / first[along] * line[along]) > ROUNDING
                                        for line in lines for i in (0, 1)):
        return []
    return [line[along] / lines[slowest][along] for line in lines]
