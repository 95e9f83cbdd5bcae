"""Where the joints are to go: the goal that is followed, the trajectory of a move, efforts instead of positions.

Vectors are (size,) in the joint space of `joints.py`, jaw last; time is the `now_ns` argument. A move of the arm and
one of the jaw share one trajectory: a new goal for one of them leaves the other's goal as it is.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from procs.arm.joints import JointSpace
from procs.inputs import FOR_EVER_NS
from procs.kinematics.trajectory import Trajectory

Array = NDArray[np.float64]

STREAM_NS = 100_000_000  # a servo command older than this is no stream any more: its velocity is no longer fed
MAX_STEP_NS = 5_000_000  # after a pause of ours a drifting joint goes on from where it is, and does not catch up


class Mode(IntEnum):
    """Control modes, as published."""

    NONE = 0
    POSITION = 1
    TRAJECTORY = 2
    EFFORT = 3


class Space(IntEnum):
    """Control spaces, as published: what the goals in force were given in."""

    NONE = 0
    JOINT = 1
    CARTESIAN = 2


class Motion:
    """The setpoint generator; `goal`, `velocity`, `effort` are what io is to follow in this cycle."""

    def __init__(self, joints: JointSpace, jerk_time_s: float = 0.0) -> None:
        """`jerk_time_s`: see `Trajectory`."""
        self._jerk_time_s = jerk_time_s
        self.ratio_v = self.ratio_a = 1.0
        self.mode, self.space = Mode.NONE, Space.NONE
        self.moving = False
        self.has_velocity = False
        self._start_ns = self._duration_ns = 0
        self._served_ns = self._jaw_ns = -STREAM_NS
        self._drifting = False
        self._stepped_ns = 0
        self.use(joints)

    def use(self, joints: JointSpace) -> None:
        """Another joint space, from the next `hold` on: other arrays, nothing is under way."""
        n = joints.size
        self._v_max, self._a_max = joints.v_max, joints.a_max
        self.rows = np.zeros((2, n))
        self.goal, self.velocity = self.rows
        self.effort, self.target = np.zeros(n), np.zeros(n)
        self.feed = np.zeros(n)
        """Efforts added while positions are followed, until `feed_end_ns`."""
        self.feed_end_ns = FOR_EVER_NS
        self._lower, self._upper = joints.lower, joints.upper
        self.in_effort = np.zeros(n, dtype=np.bool_)
        """Joints that efforts are applied to; the others follow their goal, in EFFORT mode too."""
        self._trajectory = Trajectory(n, self._jerk_time_s)
        self._enter(Mode.NONE)

    @property
    def ratio(self) -> float:
        """The common ratio of moves; 0 when velocity and acceleration differ."""
        return self.ratio_v if self.ratio_v == self.ratio_a else 0.0

    @property
    def end_ns(self) -> int:
        """When the move that runs, or ran last, ends."""
        return self._start_ns + self._duration_ns

    def hold(self, position: Array, mode: Mode = Mode.POSITION) -> bool:
        """Stay at `position`; returns whether this ended a move."""
        self.goal[...] = position
        self.target[...] = position
        self._served_ns = self._jaw_ns = -STREAM_NS
        if mode is Mode.NONE:
            self.space = Space.NONE
        return self._enter(mode)

    def servo(self, position: Array, velocity: Array | None, now_ns: int) -> bool:
        """Follow `position` from now on, with a velocity feed; returns whether this ended a move."""
        self.goal[...] = position
        self.target[...] = position
        ended = self._enter(Mode.POSITION)
        self.has_velocity = velocity is not None
        if velocity is not None:
            self.velocity[...] = velocity
        self._served_ns = now_ns
        return ended

    def drift(self, velocity: Array, now_ns: int) -> bool:
        """Go at a velocity from here on, until a stream of such commands ends or a limit comes; ended a move?"""
        ended = self.moving
        if self.mode is not Mode.POSITION or not self._drifting:
            ended = self._enter(Mode.POSITION)
            self._stepped_ns = now_ns
        self.velocity[...] = velocity
        self._drifting = self.has_velocity = True
        self._served_ns = now_ns
        return ended

    def adjust(self, position: Array, now_ns: int) -> bool:
        """Follow `position` for a part of the joints: a stream of the others goes on, with its velocities."""
        ended = self._enter(Mode.POSITION) if self.mode is not Mode.POSITION else False
        self.goal[...] = position
        self.target[...] = position
        self._jaw_ns = now_ns
        return ended

    def is_streamed(self, now_ns: int, *, jaw: bool = False) -> bool:
        """Goals are coming for the arm's joints, or for the jaw: the last one is what is followed, and not long ago."""
        if self.mode is not Mode.POSITION:
            return False
        if jaw:
            return now_ns - self._jaw_ns <= STREAM_NS
        return not self._drifting and now_ns - self._served_ns <= STREAM_NS

    def push(self, which: NDArray[np.bool_] | None = None) -> bool:
        """Apply `effort` instead of following positions, to the joints `which` (None: all); the others stay.

        Returns whether this ended a move.
        """
        ended = self._enter(Mode.EFFORT)
        self.in_effort[...] = True if which is None else which
        return ended

    def add(self, feed: Array, end_ns: int) -> None:
        """Add efforts (size,) to those that follow the position."""
        self.feed[...] = feed
        self.feed_end_ns = end_ns

    def move(self, target: Array, measured_velocity: Array, now_ns: int) -> str:
        """Go to `target` and stop there, starting from what is followed now; a move that runs is bent smoothly.

        Returns why it cannot be done, empty when it is under way; on a refusal nothing changes.
        """
        if self.moving:
            self._evaluate(now_ns)
            reason = self._plan(target, now_ns)
            if not reason:
                self.target[...] = target
            return reason
        self._trajectory.forget()
        if self.mode is Mode.POSITION and now_ns - self._served_ns < STREAM_NS:
            if not self.has_velocity:  # a stream without velocities: the arm moves about as fast as the stream
                limit = self._v_max * self.ratio_v
                self.velocity[...] = np.clip(measured_velocity, -limit, limit)
        else:
            self.velocity[...] = 0.0
        reason = self._plan(target, now_ns)
        if not reason:
            self.target[...] = target
            self.mode = Mode.TRAJECTORY
            self.in_effort[...] = False
            self._drifting = False
            self.moving = True
        return reason

    def resume(self, position: Array, now_ns: int) -> bool:
        """A move was not followed for a while and stands at `position`: go on from there, from rest.

        Returns False when that cannot be planned; the move has ended at `position` then.
        """
        self.goal[...] = position
        self.velocity[...] = 0.0
        self._trajectory.forget()
        if not self._plan(self.target, now_ns):
            return True
        self.hold(position)
        return False

    def set_ratio(self, v: float, a: float, now_ns: int) -> None:
        """New ratios, in ]0, 1]; what is left of a running move takes them on."""
        self.ratio_v, self.ratio_a = v, a
        if self.moving:
            self._evaluate(now_ns)
            self._plan(self.target, now_ns)  # should it fail, the move goes on as it was

    def step(self, now_ns: int) -> bool:
        """Advance to `now_ns`; returns whether a move has reached its end."""
        if self.moving:
            return self._advance(now_ns)
        if self._drifting:
            self._drift(now_ns)
        if self.has_velocity and now_ns - self._served_ns >= STREAM_NS:
            self.has_velocity = self._drifting = False
            self.velocity[...] = 0.0
        return False

    def _drift(self, now_ns: int) -> None:
        goal = self.goal
        goal += self.velocity * (min(now_ns - self._stepped_ns, MAX_STEP_NS) * 1e-9)
        self._stepped_ns = now_ns
        outside = ((goal < self._lower) & (self.velocity < 0.0)) | ((goal > self._upper) & (self.velocity > 0.0))
        if outside.any():
            np.copyto(goal, np.clip(goal, self._lower, self._upper), where=outside)
            self.velocity[outside] = 0.0
        self.target[...] = goal

    def pending_since(self, now_ns: int) -> bool:
        """A servo goal was given in this very cycle."""
        return self._served_ns == now_ns

    def _advance(self, now_ns: int) -> bool:
        if now_ns < self.end_ns:
            self._evaluate(now_ns)
            return False
        self.goal[...] = self.target
        self.velocity[...] = 0.0
        self.has_velocity = False
        self.moving = False
        return True

    def _enter(self, mode: Mode) -> bool:
        ended = self.moving
        if mode is not self.mode:
            self._served_ns = self._jaw_ns = -STREAM_NS
        self.moving = False
        self.mode = mode
        self.has_velocity = False
        self.velocity[...] = 0.0
        self.effort[...] = 0.0
        self.in_effort[...] = False
        self.end_feed()
        self._drifting = False
        return ended

    def end_feed(self) -> None:
        """Nothing is added any more."""
        self.feed[...] = 0.0
        self.feed_end_ns = FOR_EVER_NS

    def _evaluate(self, now_ns: int) -> None:
        self._trajectory.evaluate((now_ns - self._start_ns) * 1e-9, self.goal, self.velocity)

    def _plan(self, target: Array, now_ns: int) -> str:
        v_max, a_max = self._v_max * self.ratio_v, self._a_max * self.ratio_a
        # the trajectory's own time begins at 0: whole monotonic seconds would cost it digits
        error = self._trajectory.start(self.goal, self.velocity, target, v_max, a_max, 0.0)
        if error is not None:
            return error.value
        self._start_ns = now_ns
        self._duration_ns = round(self._trajectory.duration * 1e9)
        self.has_velocity = True
        return ""
