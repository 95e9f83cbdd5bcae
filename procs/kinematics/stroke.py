"""Motion of one joint to a goal at rest, within limits of velocity and acceleration: ramp, coast, stop.

In ramp and stop, the acceleration is constant; in between, the velocity is. Distances are those to the goal.
"""

from __future__ import annotations

import math
from typing import NamedTuple


class Profile(NamedTuple):
    """Durations and accelerations of ramp, coast and stop."""

    ramp_s: float
    coast_s: float
    stop_s: float
    ramp: float
    stop: float

    @property
    def duration_s(self) -> float:
        """Duration of all three."""
        return self.ramp_s + self.coast_s + self.stop_s

    def scaled(self, share: float) -> Profile:
        """The same profile over a share of the distance."""
        return self._replace(ramp=share * self.ramp, stop=share * self.stop)


def quickest(distance: float, velocity: float, v_max: float, a_max: float) -> Profile:
    """The shortest profile from a velocity within its limit."""
    side = 1.0 if distance >= velocity * abs(velocity) / (2.0 * a_max) else -1.0  # sign of the velocity while coasting
    distance, velocity = side * distance, side * velocity
    peak = math.sqrt(max(0.0, velocity * velocity / 2.0 + a_max * distance))
    peak = min(max(peak, velocity, 0.0), v_max)
    rest = distance - (2.0 * peak * peak - velocity * velocity) / (2.0 * a_max)
    coast_s = max(0.0, rest / peak) if peak > 0.0 else 0.0
    return Profile((peak - velocity) / a_max, coast_s, peak / a_max, side * a_max, -side * a_max)


def lasting(duration_s: float, distance: float, velocity: float, a_max: float) -> Profile:
    """A profile with this duration, which must be longer than that of the quickest."""
    side = -1.0 if velocity < 0.0 else 1.0
    distance, velocity = side * distance, side * velocity
    braking = velocity * velocity / (2.0 * a_max)
    if braking < distance < velocity * duration_s - braking:  # it only has to slow down
        ramp_s = 2.0 * distance / velocity
        if side > 0.0 and 0.0 < ramp_s <= duration_s:  # as ruckig: gently to the goal, and wait there
            return Profile(ramp_s, duration_s - ramp_s, 0.0, -side * velocity / ramp_s, 0.0)
        coast_s = duration_s - velocity / a_max
        slow = (distance - braking) / coast_s if coast_s > 0.0 else 0.0
        return Profile((velocity - slow) / a_max, coast_s, slow / a_max, -side * a_max, -side * a_max)
    if distance <= braking:  # it passes the goal and returns
        side, distance, velocity = -side, -distance, -velocity
    square = 2.0 * a_max * distance + 2.0 * a_max * (distance - duration_s * velocity) + velocity * velocity
    coast_s = math.sqrt(max(0.0, duration_s * duration_s - square / a_max / a_max))
    ramp_s = max(0.0, (duration_s - coast_s - velocity / a_max) / 2.0)
    return Profile(ramp_s, coast_s, duration_s - coast_s - ramp_s, side * a_max, -side * a_max)
