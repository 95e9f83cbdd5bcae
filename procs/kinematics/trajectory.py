"""Joint trajectories to a goal at rest, time-optimal within velocity and acceleration limits, with ruckig.

All joints end at the same time, and along a straight line in joint space if the start allows it. Without a jerk limit a
move from rest over a distance d takes 2·√(d/a), or d/v + v/a once it reaches v. The caller gives the time, in seconds.
"""

from __future__ import annotations

import enum
import math

import numpy as np
import ruckig

from trocar.procs.kinematics.poses import Array


class PlanError(enum.Enum):
    """Why a trajectory could not be planned; the value is a sentence for messages."""

    SIZE = "start, goal and limits must have one number per joint"
    NOT_FINITE = "start, goal and limits must be finite"
    LIMITS = "velocity and acceleration limits must be positive"
    NO_SOLUTION = "no trajectory found from this start to this goal"


class Trajectory:
    """One trajectory of n joints at a time; `start` replaces the one in progress.

    To change the goal in mid-flight, start again from the last `evaluate`: position and velocity stay continuous, with
    a jerk limit acceleration, too. Call `forget` before a start from another state. A start faster than v_max (the
    limit was lowered) is braked first.
    """

    def __init__(self, n: int, jerk_time_s: float = 0.0) -> None:
        """`jerk_time_s`: time for acceleration to reach its limit; 0: no jerk limit."""
        self.n = n
        self._jerk_time_s = jerk_time_s
        self._acceleration = [0.0] * n  # at the last evaluation
        self.duration = 0.0  # s, of the whole trajectory
        self.active = False  # a trajectory was started and its end was not evaluated yet
        self._start_s = 0.0
        self._goal = np.zeros(n)
        self._planner = ruckig.Ruckig(n)
        self._path = ruckig.Trajectory(n)
        self._request = ruckig.InputParameter(n)
        self._request.synchronization = ruckig.Synchronization.Phase  # by time if phase is not possible
        self._request.max_jerk = [math.inf] * n

    @property
    def goal(self) -> Array:
        """End of the trajectory (n,): its own array, do not write."""
        return self._goal

    def start(
        self, position: Array, velocity: Array, goal: Array, v_max: Array, a_max: Array, now_s: float
    ) -> PlanError | None:
        """Plan from (position, velocity) now to `goal` at rest; all (n,). On an error the previous trajectory
        continues.
        """
        error = _fault(self.n, position, velocity, goal, v_max, a_max)
        if error is not None:
            return error
        request = self._request
        request.current_position = position.tolist()
        request.current_velocity = velocity.tolist()
        request.target_position = goal.tolist()
        request.max_velocity = v_max.tolist()
        request.max_acceleration = a_max.tolist()
        if self._jerk_time_s > 0.0:
            request.max_jerk = (a_max / self._jerk_time_s).tolist()
            request.current_acceleration = self._acceleration if self.active else [0.0] * self.n
        path = ruckig.Trajectory(self.n)  # a plan that fails must not spoil the one being followed
        try:
            result = self._planner.calculate(request, path)
        except ruckig.RuckigError:
            return PlanError.NO_SOLUTION
        if result != ruckig.Result.Working or not math.isfinite(path.duration):
            return PlanError.NO_SOLUTION
        self._path = path
        self.duration = float(path.duration)
        self._start_s = now_s
        self._goal[...] = goal
        self.active = True
        return None

    def forget(self) -> None:
        """The next start is from another position, or from rest."""
        self.active = False

    def evaluate(self, now_s: float, position: Array, velocity: Array) -> bool:
        """Write position and velocity (n,) at time `now_s`; True once the goal is reached (exactly, at rest)."""
        elapsed = now_s - self._start_s
        if elapsed >= self.duration:
            position[...] = self._goal
            velocity[...] = 0.0
            self.active = False
            return True
        position[...], velocity[...], self._acceleration = self._path.at_time(max(elapsed, 0.0))
        return False


def _fault(n: int, position: Array, velocity: Array, goal: Array, v_max: Array, a_max: Array) -> PlanError | None:
    """Errors in the planner's input: checked here, so that no exception is raised in a control loop."""
    vectors = (position, velocity, goal, v_max, a_max)
    if any(vector.shape != (n,) for vector in vectors):
        return PlanError.SIZE
    if not all(np.isfinite(vector).all() for vector in vectors):
        return PlanError.NOT_FINITE
    if not ((v_max > 0.0).all() and (a_max > 0.0).all()):
        return PlanError.LIMITS
    return None
