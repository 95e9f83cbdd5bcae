"""Motion of the joints: the target of a stream, the trajectory of a move, efforts instead of positions.

io receives `goal`: for a stream, the governor's output for its target in this cycle; for a move, the point of its
trajectory. Vectors are (size,) in the joint space of `joints.py`, jaw last; time is the `now_ns` argument. A move of
the arm and one of the jaw share one trajectory: a new goal for one of them leaves the other's goal unchanged. A stream
of the jaw beside a move of the arm has the jaw's part of the governor; beside a stream of the arm, a move of the jaw
has a trajectory of its own, whose points are targets of the jaw.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.arm.governor import MAX_STEP_NS, Governor
from trocar.procs.arm.joints import JointSpace
from trocar.procs.kinematics.poses import Array
from trocar.procs.kinematics.trajectory import Trajectory
from trocar.procs.node.inputs import FOR_EVER_NS
from trocar.procs.node.streams import STREAM_NS

NO_STEP: Final = np.zeros((2, 0))
WOKEN_STEP_NS = 2_000_000  # when a motion begins: the process of an arm at rest has slept since its last step
ENDED = 0.01  # of the speed of a move: slower than that before another arm, it has ended
FORGOTTEN_NS = 1_000_000_000  # a goal that a wall holds back for so long after its stream is not reached later either


class Mode(IntEnum):
    """Control modes, as published."""

    NONE = 0
    POSITION = 1
    TRAJECTORY = 2
    EFFORT = 3


NONE, POSITION, TRAJECTORY, EFFORT = Mode
"""Its members: to look one up in its class takes as long as a call."""


class Space(IntEnum):
    """Control spaces, as published: the space of the goals in force."""

    NONE = 0
    JOINT = 1
    CARTESIAN = 2


class Motion:
    """The setpoint generator; io follows `goal`, `velocity` and `effort` in this cycle.

    `target` is the target of the joints, `asked` the working copy of the current command, `feed_velocity` the
    velocities that a stream gave with its target. They stay the same objects in one joint space, see
    `trocar.procs.arm.governor`.
    """

    def __init__(self, joints: JointSpace, jerk_time_s: float = 0.0) -> None:
        """`jerk_time_s`: see `Trajectory`."""
        self._jerk_time_s = jerk_time_s
        self.ratio_v = self.ratio_a = 1.0
        self.mode, self.space = NONE, Space.NONE
        self.moving = False
        self.has_velocity = False
        self._start_ns = self._duration_ns = 0
        self._served_ns = -STREAM_NS
        self.drifting = False
        """Its target moves at `feed_velocity`."""
        self.settled = True
        """The setpoint is at its target."""
        self.jaw_streams = False
        """While the others move, the jaw follows its target."""
        self.jaw_moves = False
        """While the others follow a stream, the jaw moves."""
        self.stopped = False
        """A wall ended the move of the last cycle."""
        self._stepped_ns, self._rested, self._pace = 0, True, 1.0  # the share of its speed that a move has, see _slow
        self.use(joints)

    def use(self, joints: JointSpace) -> None:
        """Use another joint space, from the next `hold` on: new arrays, no motion in progress."""
        n = joints.size
        self._v_max, self._a_max = joints.v_max, joints.a_max
        self.rows = np.zeros((2, n))
        self.goal, self.velocity = self.rows
        self.effort, self.target, self.asked, self.feed_velocity, self._last = np.zeros((5, n))
        self._arm = slice(0, n - joints.has_jaw)
        self.governor = Governor(self, joints.servo_speed, joints.servo_acceleration, joints.lower, joints.upper)
        self._has_jaw, self._jaw_governor = joints.has_jaw, self.governor.of_last()
        self.feed = np.zeros(n)
        """Efforts added to position control, until `feed_end_ns`."""
        self.feed_end_ns = FOR_EVER_NS
        self._lower, self._upper = joints.lower, joints.upper
        self.in_effort = np.zeros(n, dtype=np.bool_)
        """Joints that efforts are applied to; the others follow their goal, in EFFORT mode too."""
        self._trajectory, self._jaw_path = Trajectory(n, self._jerk_time_s), Trajectory(1, self._jerk_time_s)
        self._jaw_point, self._jaw_velocity = np.zeros((2, 1))
        self._enter(NONE)

    @property
    def ratio(self) -> float:
        """The common ratio of moves; 0 when velocity and acceleration differ."""
        return self.ratio_v if self.ratio_v == self.ratio_a else 0.0

    @property
    def end_ns(self) -> int:
        """End of the move that runs, or ran last."""
        return self._start_ns + self._duration_ns

    def hold(self, position: Array, mode: Mode = POSITION) -> None:
        """Stay at `position`."""
        self.goal[...] = self._last[...] = position
        self.target[...] = position
        self.governor.start(0.0)
        self.settled, self.jaw_moves = True, False
        self._served_ns = -STREAM_NS
        if mode is NONE:
            self.space = Space.NONE
        self._enter(mode)

    def servo(self, position: Array, velocity: Array | None, now_ns: int, *, jaw_moves: bool = False) -> None:
        """Follow `position` from now on, with a velocity feed; if the `jaw_moves`, its move continues."""
        self._enter_stream(now_ns, jaw_moves=jaw_moves)
        self.target[...] = position
        self.settled = False
        self.has_velocity = velocity is not None
        if velocity is not None:
            self.feed_velocity[...] = velocity
        self._served_ns = now_ns

    def drift(self, velocity: Array, now_ns: int, *, jaw_moves: bool = False) -> None:
        """Move at a velocity, until the stream of such commands ends or a limit is reached; as for `servo`."""
        if self.mode is not POSITION or not self.drifting:
            self._enter_stream(now_ns, jaw_moves=jaw_moves)
            self.target[...] = self.goal
        self.feed_velocity[...] = velocity
        self.drifting = self.has_velocity = True
        self._served_ns = now_ns

    def adjust(self, position: Array, *, moves: bool) -> None:
        """Follow `position` with the jaw: a stream of the others continues, with its velocities, and if it `moves`, a
        move.
        """
        if moves and self.moving:
            self.jaw_streams = True
            self.target[-1] = position[-1]
            return
        if self.mode is not POSITION:
            self._enter(POSITION)
        self.target[...] = position
        self.settled = self.jaw_moves = False

    def push(self, which: NDArray[np.bool_] | None = None) -> None:
        """Apply `effort` instead of following positions, to the joints `which` (None: all); the others stay."""
        self._enter(EFFORT)
        self.in_effort[...] = True if which is None else which

    def add(self, feed: Array, end_ns: int) -> None:
        """Add efforts (size,) to position control."""
        self.feed[...] = feed
        self.feed_end_ns = end_ns

    def move(self, target: Array, measured_velocity: Array, now_ns: int, *, jaw: bool = True) -> str:
        """Move to `target` and stop there, starting from the present setpoint; a running move is redirected smoothly.

        Without `jaw`, a jaw that follows a stream continues. Returns the reason for a refusal, empty when the move is
        in progress; on a refusal nothing changes.
        """
        if self.moving:
            streams = self.jaw_streams and not jaw
            reason = self._plan_again(target, now_ns, streams)
            if not reason:
                self.target[...] = target
                self.jaw_streams = streams
            return reason
        self._trajectory.forget()
        if self.is_streaming(now_ns):
            if not self.has_velocity:  # a stream without velocities: the arm moves about as fast as the stream
                limit = self._v_max * self.ratio_v
                self.velocity[...] = np.clip(measured_velocity, -limit, limit)
            self._bound_start()
        else:
            self.velocity[...] = 0.0
        if self.jaw_moves:  # the arm's move takes it along
            self.velocity[-1] = self._jaw_velocity.item()
        streams = (self._has_jaw and not jaw and not self.jaw_moves and self.mode is POSITION
                   and self.goal[-1] != target[-1])
        reason = self._plan(target, now_ns, streams)
        if not reason:
            self.target[...] = target
            self.mode = TRAJECTORY
            self.in_effort[...] = False
            self.drifting = False
            self.moving, self.jaw_streams, self.jaw_moves = True, streams, False
        return reason

    @property
    def jaw_goal(self) -> float:
        """Where the jaw is going."""
        return float(self._jaw_path.goal[0] if self.jaw_moves else self.target[-1])

    def is_streaming(self, now_ns: int) -> bool:
        """Whether a stream of the arm has had a goal recently."""
        return self.mode is POSITION and now_ns - self._served_ns < STREAM_NS

    def move_jaw(self, goal: float, now_ns: int) -> str:
        """Move the jaw beside a stream of the arm, or redirect that move; returns as `move` does."""
        return self._move_jaw(goal, self._jaw_velocity.item() if self.jaw_moves else 0.0, now_ns)

    def _move_jaw(self, goal: float, velocity: float, now_ns: int) -> str:
        if not self.jaw_moves:
            self._jaw_path.forget()
        v_max, a_max = self._v_max[-1:] * self.ratio_v, self._a_max[-1:] * self.ratio_a
        error = self._jaw_path.start(self.goal[-1:], np.array([velocity]), np.array([goal]), v_max, a_max, 0.0)
        if error is not None:
            return error.value
        self._start_ns, self._duration_ns = now_ns, round(self._jaw_path.duration * 1e9)
        self.jaw_moves = True
        return ""

    def _bound_start(self) -> None:
        """Moves brake more gently than streams: limit the start velocity so that the move stays within the joint
        limits. To stop from v takes v²/(2a), and v·J/2 more with a jerk limit.
        """
        room = np.where(self.velocity > 0.0, self._upper - self.goal, self.goal - self._lower)
        a_max = self._a_max * self.ratio_a
        rise = a_max * self._jerk_time_s / 2.0
        most = np.sqrt(rise * rise + a_max * np.maximum(room, 0.0)) - rise  # stops in half of it
        np.minimum(self.velocity, most, out=self.velocity)
        np.maximum(self.velocity, -most, out=self.velocity)

    def resume(self, position: Array, now_ns: int) -> bool:
        """A move was not followed for a while and is held at `position`: continue from there, from rest.

        Returns False if planning fails; then the move has ended at `position`.
        """
        self.goal[...] = self._last[...] = position
        self.velocity[...] = 0.0
        self._trajectory.forget()
        if not self._plan(self.target, now_ns, self.jaw_streams):
            return True
        self.hold(position)
        return False

    def set_ratio(self, v: float, a: float, now_ns: int) -> None:
        """New ratios, in ]0, 1]; they apply to the rest of a running move."""
        self.ratio_v, self.ratio_a = v, a
        if self.moving:
            self._plan_again(self.target, now_ns, self.jaw_streams)  # should it fail, the move continues unchanged
        elif self.jaw_moves:
            self.move_jaw(self.jaw_goal, now_ns)

    def step(self, now_ns: int) -> None:
        """Advance to `now_ns`."""
        passed_ns, self._stepped_ns, self.stopped = now_ns - self._stepped_ns, now_ns, False
        self._step(now_ns, min(passed_ns, WOKEN_STEP_NS) if self._rested else passed_ns)
        self._rested = self.settled and not (self.moving or self.drifting)
        self._last[...] = self.goal

    def _step(self, now_ns: int, passed_ns: int) -> None:
        if self.moving:
            if self.jaw_streams:
                self._jaw_governor.step(passed_ns, has_feed=False)
            self._advance(now_ns)
            clip = self.governor.clip  # since the last cycle, a command may have taken the setpoint further, too
            if not self._slow(now_ns, passed_ns) or (clip is not None and clip(self._last, self.goal, NO_STEP, 0.0)):
                self.hold(self._last.copy())
                self.stopped = True
            return
        if self.has_velocity and now_ns - self._served_ns >= STREAM_NS:
            self.has_velocity = self.drifting = False
            self.velocity[...] = 0.0
        if self.drifting:
            self._drift(passed_ns)
        if self.jaw_moves:
            at_s = (now_ns - self._start_ns) * 1e-9
            self.jaw_moves = not self._jaw_path.evaluate(at_s, self._jaw_point, self._jaw_velocity)
            self.target[-1] = self._jaw_point.item()
            self.settled = False
        if not self.settled and self.mode is POSITION:
            self.settled = not self.governor.step(passed_ns, has_feed=self.has_velocity)
            if self.governor.clipped and (self.drifting or now_ns - self._served_ns >= FORGOTTEN_NS):
                self.target[self._arm] = self.goal[self._arm]  # not there later by itself, when the wall has gone

    def _slow(self, now_ns: int, passed_ns: int) -> bool:
        """Before another arm, the time of the trajectory passes more slowly; False: it has come to an end there.

        Afterwards the joints get faster by their acceleration, besides that of the trajectory.
        """
        slow = self.governor.slow
        if not self.moving or (slow is None and self._pace == 1.0):
            return True
        share = 1.0 if slow is None else slow(self._last, self.goal, passed_ns * 1e-9)
        if min(share, self._pace) < 1.0:
            joints = slice(0, -1 if self.jaw_streams else None)
            needed_s = float((np.abs(self.velocity) / (self._a_max * self.ratio_a))[joints].max()) / self._pace
            self._pace = min(share, 1.0, self._pace + passed_ns * 1e-9 / max(needed_s, 1e-9))
            self._start_ns = min(self._start_ns + round((1.0 - self._pace) * passed_ns), now_ns)
            self._evaluate(now_ns)
        return share > ENDED

    def _drift(self, passed_ns: int) -> None:
        target, velocity = self.target, self.feed_velocity
        target += velocity * (min(passed_ns, MAX_STEP_NS) * 1e-9)
        outside = ((target < self._lower) & (velocity < 0.0)) | ((target > self._upper) & (velocity > 0.0))
        if outside.any():
            np.copyto(target, np.clip(target, self._lower, self._upper), where=outside)
            velocity[outside] = 0.0
        self.settled = False

    def is_pending(self, now_ns: int) -> bool:
        """Whether a servo goal was given in this very cycle, or has not been reached yet."""
        return self._served_ns == now_ns or (self.mode is POSITION and not self.settled)

    def _advance(self, now_ns: int) -> None:
        if now_ns < self.end_ns:
            self._evaluate(now_ns)
        elif self.jaw_streams:
            self.goal[:-1] = self.target[:-1]
            self.velocity[:-1] = 0.0
            self._enter(POSITION)
            self.settled = False
        else:
            self.goal[...] = self.target
            self.velocity[...] = 0.0
            self.has_velocity = False
            self.moving = False

    def _enter_stream(self, now_ns: int, *, jaw_moves: bool) -> None:
        """Positions from now on; a move of the jaw that was part of the trajectory gets one of its own."""
        if not (jaw_moves and self.moving):
            self._enter(POSITION)
            return
        goal, velocity = self.target[-1].item(), self.velocity[-1].item()
        self._enter(POSITION)
        self._move_jaw(goal, velocity, now_ns)

    def _enter(self, mode: Mode) -> None:
        if mode is self.mode is POSITION:  # the next goal of a stream
            self.drifting = False
            if self.has_velocity:
                self.has_velocity = False
                self.velocity[...] = 0.0
            if self.feed_end_ns != FOR_EVER_NS:
                self.end_feed()
            return
        if mode is not self.mode:
            self._served_ns = -STREAM_NS
            self.governor.start(self.velocity if self.moving else 0.0)
        self.moving = self.jaw_streams = self.jaw_moves = False
        self.mode = mode
        self.has_velocity = False
        self.velocity[...] = 0.0
        self.effort[...] = 0.0
        self.in_effort[...] = False
        self.end_feed()
        self.drifting = False

    def end_feed(self) -> None:
        """End the added efforts."""
        self.feed[...] = 0.0
        self.feed_end_ns = FOR_EVER_NS

    def _evaluate(self, now_ns: int) -> None:
        jaw = self.goal[-1]
        self._trajectory.evaluate((now_ns - self._start_ns) * 1e-9, self.goal, self.velocity)
        self.velocity *= self._pace
        if self.jaw_streams:
            self.goal[-1], self.velocity[-1] = jaw, self.governor.rate[-1]
        elif self._has_jaw:
            self.governor.rate[-1] = self.velocity[-1]  # from where a stream of the jaw begins

    def _plan_again(self, target: Array, now_ns: int, jaw_streams: bool) -> str:
        """Plan a running move from where it is now, at the speed it has."""
        before_ns = self._start_ns
        if self._pace < 1.0:
            self._start_ns += round((1.0 - self._pace) * (now_ns - self._stepped_ns))
            self._trajectory.forget()  # its acceleration is not that of the setpoint
        self._evaluate(now_ns)
        if reason := self._plan(target, now_ns, jaw_streams):
            self._start_ns = before_ns
        return reason

    def _plan(self, target: Array, now_ns: int, jaw_streams: bool) -> str:
        v_max, a_max = self._v_max * self.ratio_v, self._a_max * self.ratio_a
        velocity = self.velocity
        if jaw_streams:  # it does not belong to the trajectory, so it must not make it longer
            target, velocity = target.copy(), velocity.copy()
            target[-1], velocity[-1] = self.goal[-1], 0.0
        # the trajectory's own time begins at 0: whole monotonic seconds would cost it digits
        error = self._trajectory.start(self.goal, velocity, target, v_max, a_max, 0.0)
        if error is not None:
            return error.value
        self._start_ns, self._pace = now_ns, 1.0
        self._duration_ns = round(self._trajectory.duration * 1e9)
        self.has_velocity = True
        return ""
