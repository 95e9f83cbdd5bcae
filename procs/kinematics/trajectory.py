"""Joint trajectories to a goal at rest, time-optimal within velocity and acceleration limits.

All joints end at the same time, and along a straight line in joint space if the start allows it. Without a jerk limit a
move from rest over a distance d takes 2·√(d/a), or d/v + v/a once it reaches v. The caller gives the time, in seconds.
"""

from __future__ import annotations

import enum
import math
from typing import Final

import numpy as np

from trocar.procs.kinematics.pieces import Pieces, State, interval
from trocar.procs.kinematics.plan import Joint, synchronized
from trocar.procs.kinematics.poses import Array

LARGEST: Final = 1e100
"""Larger numbers count as infinite, so that products of three are finite."""
MAX_DURATION_S: Final = 7600.0
"""A trajectory that takes longer is refused."""


class PlanError(enum.Enum):
    """Why a trajectory could not be planned; the value is a sentence for messages."""

    SIZE = "start, goal and limits must have one number per joint"
    NOT_FINITE = "start, goal and limits must be finite"
    LIMITS = "velocity and acceleration limits must be positive"
    NO_SOLUTION = "found no trajectory from this start to this goal that takes at most 7600 s"


class Trajectory:
    """One trajectory of n joints at a time; `start` replaces the one in progress.

    To change the goal in mid-flight, start again from the last `evaluate`: position and velocity stay continuous, with
    a jerk limit acceleration, too. Call `forget` before a start from another state. A start faster than v_max (the
    limit was lowered) is braked first.
    """

    def __init__(self, n: int, jerk_time_s: float = 0.0) -> None:
        """`jerk_time_s`: time for acceleration to reach its limit, which needs ruckig; 0: no jerk limit."""
        self.n = n
        self._jerk_time_s = jerk_time_s
        self.duration = 0.0  # s, of the whole trajectory
        self.active = False  # a trajectory was started and its end was not evaluated yet
        self._start_s = self._elapsed_s = 0.0  # the start, and the time since then at the last evaluation
        self._goal = np.zeros(n)
        self._joints: tuple[Pieces, ...] = ()
        self._since_s = self._until_s = 0.0  # the interval of the last evaluation
        self._states: list[State] = []  # at its start
        if jerk_time_s:
            from trocar.procs.kinematics.jerk import jerk_limited  # now: an import takes longer than a cycle

            self._jerk_limited = jerk_limited

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
        if self._jerk_time_s:
            present = self._accelerations() * ((velocity != 0.0) | (position != goal))  # none of a joint that rests
            duration, joints = self._jerk_limited(position, velocity, present.tolist(), goal, v_max, a_max,
                                                  self._jerk_time_s)
        else:
            duration, joints = synchronized([Joint(*numbers) for numbers in zip(
                position.tolist(), velocity.tolist(), goal.tolist(), v_max.tolist(), a_max.tolist(), strict=True)])
        if not (duration <= MAX_DURATION_S and all(math.isfinite(states[-1][0]) for _, states in joints)):
            return PlanError.NO_SOLUTION
        self.duration, self._joints = duration, joints
        self._start_s, self._elapsed_s = now_s, 0.0
        self._since_s, self._until_s, self._states = interval(self._joints, 0.0)
        self._goal[...] = goal
        self.active = True
        return None

    def forget(self) -> None:
        """The next start is from another position, or from rest."""
        self.active = False

    def evaluate(self, now_s: float, position: Array, velocity: Array) -> bool:
        """Write position and velocity (n,) at time `now_s`; True once the goal is reached (exactly, at rest)."""
        elapsed_s = now_s - self._start_s
        if elapsed_s >= self.duration:
            position[...] = self._goal
            velocity[...] = 0.0
            self.active = False
            return True
        elapsed_s = elapsed_s if elapsed_s > 0.0 else 0.0  # max() takes longer
        if not self._since_s <= elapsed_s < self._until_s:
            self._since_s, self._until_s, self._states = interval(self._joints, elapsed_s)
        self._elapsed_s = elapsed_s
        past_s = elapsed_s - self._since_s
        half_s, joint = past_s / 2.0, 0
        if self._jerk_time_s:
            for p, v, a, jerk in self._states:
                velocity[joint] = v + past_s * (a + half_s * jerk)
                position[joint] = p + past_s * (v + half_s * (a + past_s / 3.0 * jerk))
                joint += 1
        else:
            for p, v, a, _ in self._states:
                velocity[joint] = end = v + past_s * a
                position[joint] = p + half_s * (v + end)
                joint += 1
        return False

    def _accelerations(self) -> Array:
        """At the last evaluation; 0 without a jerk limit, and from rest."""
        if not self.active:
            return np.zeros(self.n)
        past_s = self._elapsed_s - self._since_s
        return np.array([acceleration + past_s * jerk for _, _, acceleration, jerk in self._states])


def _fault(n: int, position: Array, velocity: Array, goal: Array, v_max: Array, a_max: Array) -> PlanError | None:
    """Errors in the planner's input: checked here, so that no exception is raised in a control loop."""
    vectors = (position, velocity, goal, v_max, a_max)
    if any(vector.shape != (n,) for vector in vectors):
        return PlanError.SIZE
    if not all((np.abs(vector) <= LARGEST).all() for vector in vectors):
        return PlanError.NOT_FINITE
    if not ((v_max > 0.0).all() and (a_max > 0.0).all()):
        return PlanError.LIMITS
    return None
