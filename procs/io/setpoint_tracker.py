"""Setpoints of the arms: accepted while fresh and current, held otherwise.

A setpoint counts when it is younger than `setpoint_timeout_s` and names the present bias and the present enable of the
joint controller. For every actuator it sets whether its effort is applied or its position followed; its other values
for the actuator are ignored. Without a fresh one the last accepted position is held, with its feed-forward (gravity)
and without its velocity; where efforts were applied, the joint controller takes over at the measured position.

Whatever an arm sends, setpoints move no faster than `max_speeds` of the joint controller's row: about twice the arm's
own limit (procs/arm/governor.py). That is the last bound before the motors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.io.pid import Pid
from trocar.procs.io.record import Flags, Floats
from trocar.procs.io.robots import IoData
from trocar.procs.io.setpoint_rings import RingSource, rings_of
from trocar.procs.tables import codes
from trocar.procs.tables.generation import next_generation

DRIVE: Final = 1  # mode of a setpoint that commands motion or effort


@dataclass(slots=True)
class TrackedRobot:
    """One controlled robot and the source of its setpoints."""

    place: int  # index in the arrays of SetpointTracker
    robot: int
    axes: slice
    arm: str
    source: RingSource
    in_effort: bytes = b""  # flags of the newest setpoint; empty: no actuator
    lost: bool = False
    off: bool = False


class SetpointTracker:
    """Feeds the joint controller from the arms' rings."""

    def __init__(self, data: IoData, pid: Pid, sources: Sequence[RingSource]) -> None:
        """`sources` in the order of `io.pids`."""
        robots, io = data.robots, data.robots.io
        self._robots, self._pid, self._io = robots, pid, io
        self._samples, self._record, self._reports = data.samples, data.record, data.reports
        n = robots.axes
        self.timeout_ns = round(io.setpoint_timeout_s * 1e9)
        self._lost_ns = round(io.arm_lost_s * 1e9)
        self._off_ns = round(io.arm_lost_power_off_s * 1e9)
        self.incoming: Floats = np.zeros((4, n))  # position, velocity, effort, feed-forward as received
        self._wanted: Floats = np.zeros(n)
        self._finite: NDArray[np.bool_] = np.ones((4, n), dtype=bool)
        pid.requested_effort, pid.feed_forward = self.incoming[2], self.incoming[3]
        self.low, self.high = np.full(n, -np.inf), np.full(n, np.inf)
        self._most = np.full(n, np.inf)
        self.most_step: Floats = np.full(n, np.inf)
        """How far a setpoint may move in one cycle; inf where the setpoint is our own, or where that is unknown."""
        self.dirty: Flags = np.zeros(1, dtype=bool)
        self.followers: list[TrackedRobot] = []
        for row, source in zip(io.pids, sources, strict=True):
            robot = robots.names.index(row.robot)
            self.followers.append(TrackedRobot(len(self.followers), robot, robots.slices[robot], row.arm, source))
            if row.max_speeds:
                self._most[robots.slices[robot]] = np.array(row.max_speeds) * io.period_s
        self._of_robot = {f.robot: f for f in self.followers}
        self.count = count = len(self.followers)
        self.rings = rings_of(sources)
        self.robot, self.first, self.axes = (np.array(values, dtype=np.int64) for values in (
            [f.robot for f in self.followers], [f.axes.start for f in self.followers],
            [f.axes.stop - f.axes.start for f in self.followers]))
        self.everything = (1 << count + 2) - 1
        """Bits of all robots, for `receive`, plus one for setpoints still to apply and `desired_bit` for open desired
        states.
        """
        self.desired_bit = 1 << count + 1
        self.is_fresh: Flags = np.zeros(count, dtype=bool)  # the newest record is fresh
        self.taken_ns: NDArray[np.int64] = np.zeros(count, dtype=np.int64)  # stamp of the newest accepted setpoint
        self.fresh_ns: NDArray[np.int64] = np.zeros(count, dtype=np.int64)  # of the last fresh one, or of the enable
        self.resting: Flags = np.ones(count, dtype=bool)  # no command is active
        self.velocity: Flags = np.zeros(count, dtype=bool)
        self.applies_effort: Flags = np.zeros(count, dtype=bool)
        self.own: Flags = np.ones(count, dtype=bool)
        """The present setpoint is our own (enable, takeover): limits do not move it."""

    def newest_ns(self, robot: int) -> int:
        """Stamp of the newest setpoint accepted from the robot's arm; 0: none."""
        return int(self.taken_ns[self._of_robot[robot].place]) if robot in self._of_robot else 0

    def controlled(self, robot: int) -> bool:
        """Whether the robot has a joint controller."""
        return robot in self._of_robot

    def enable(self, robot: int, on: bool, now_ns: int) -> None:
        """Switch the joint controller on, holding the present position, or off with zero effort."""
        follower, record = self._of_robot.get(robot), self._record
        if follower is None:
            return
        axes = follower.axes
        self._pid.enable(axes, on, self._samples.position)
        self.incoming[:, axes] = 0.0
        self._stay(follower, np.ones(axes.stop - axes.start, dtype=bool))
        place = follower.place
        self.resting[place], self.velocity[place], self.fresh_ns[place] = True, False, now_ns
        self._note_efforts(follower, b"")
        follower.lost = follower.off = False
        record.pid_enabled[robot] = on
        record.holding[robot] = False
        if on:
            record.pid_generation[robot] = next_generation(int(record.pid_generation[robot]))

    def enforce_limits(self, robot: int, on: bool) -> str:
        """Clip setpoints from now on; a held position does not move. Returns the reason for a refusal, or ""."""
        axes = self._robots.slices[robot]
        if on and not (np.any(self._robots.lower[axes]) or np.any(self._robots.upper[axes])):
            return "all its position limits are 0"
        self._record.limits_enforced[robot] = on
        follower = self._of_robot.get(robot)
        if follower is not None:
            self.incoming[0, axes] = self._pid.setpoint_position[axes]
            self.own[follower.place] = True
            self._limit(follower)
        return ""

    def use_velocity(self, robot: int, on: bool) -> None:
        """Use the velocity feed of setpoints."""
        self._record.use_setpoint_velocity[robot] = on

    def receive(self, now_ns: int, which: int) -> None:
        """Take the newest setpoints of some arms (bits of `which`), then update the joint controller's references."""
        record = self._record
        for follower in self.followers:
            place = follower.place
            if not which >> place & 1:
                continue
            source = follower.source
            is_whole = source.newest() if self.rings is None else self.rings.newest(place)
            stamp_ns = source.stamp_ns if is_whole else 0  # a torn record is ignored
            if stamp_ns < 0:
                stamp_ns = 0  # a stamp that no clock here can give
            age_ns = now_ns - stamp_ns
            robot = follower.robot
            record.setpoint_age_ns[robot] = max(0, age_ns) if stamp_ns else -1
            is_fresh = self.is_fresh[place] = stamp_ns != 0 and -self.timeout_ns <= age_ns <= self.timeout_ns
            if not record.pid_enabled[robot]:
                continue
            if is_fresh:
                self.fresh_ns[place] = stamp_ns
                if stamp_ns != self.taken_ns[place] or self.resting[place]:
                    self.taken_ns[place] = stamp_ns
                    self._take(follower)
            else:
                self._stale(follower, now_ns)
        if self.dirty[0]:
            self._apply(now_ns)

    def _take(self, follower: TrackedRobot) -> None:
        """Apply a fresh record, if it names the present bias and enable."""
        source, record, robot, axes = follower.source, self._record, follower.robot, follower.axes
        if record.holding[robot]:
            record.holding[robot] = follower.lost = follower.off = False
            self._reports.status(f"setpoints of {follower.arm} resumed", self._robots.names[robot])
        count = axes.stop - axes.start
        meant = (source.bias_generation.item() == record.bias_generation[robot]
                 and source.pid_generation.item() == record.pid_generation[robot])
        if source.mode.item() != DRIVE or not meant or source.count.item() != count:
            self._rest(follower)
            return
        place = follower.place
        self.resting[place] = False
        incoming = self.incoming
        incoming[0, axes] = source.position[:count]
        incoming[3, axes] = source.feed_forward[:count]
        velocity = bool(source.has_velocity.item() and record.use_setpoint_velocity[robot])
        if velocity:
            incoming[1, axes] = source.velocity[:count]
        if velocity != self.velocity[place]:
            self._carry_velocity(follower, velocity)
        in_effort = source.in_effort[:count].tobytes()
        if in_effort != (follower.in_effort or bytes(count)):
            self._note_efforts(follower, in_effort if any(in_effort) else b"")
            self._pid.use_effort(axes, np.frombuffer(in_effort, np.uint8) != 0)
            incoming[2, axes] = 0.0
            self._limit(follower)
        if follower.in_effort:
            self._pass_efforts(source, axes, count)
        if self.own[place]:
            self.own[place] = False
            self._limit(follower)
        self.dirty[0] = True

    def _pass_efforts(self, source: RingSource, axes: slice, count: int) -> None:
        """In effort mode an actuator's effort counts; its position setpoint is the measured one."""
        incoming, in_effort = self.incoming, self._pid.effort_mode[axes]
        np.copyto(incoming[0, axes], self._samples.position[axes], where=in_effort)
        np.copyto(incoming[1, axes], 0.0, where=in_effort)
        np.copyto(incoming[2, axes], source.effort[:count], where=in_effort)

    def _stale(self, follower: TrackedRobot, now_ns: int) -> None:
        """No fresh setpoint: hold; report once, and again while the arm stays silent."""
        record, robot = self._record, follower.robot
        silent_ns = now_ns - int(self.fresh_ns[follower.place])
        if not record.holding[robot] and silent_ns > self.timeout_ns:
            record.holding[robot] = True
            self._rest(follower)
            self._reports.status(f"no setpoint of {follower.arm}; holding", self._robots.names[robot])
        if silent_ns > self._lost_ns and not follower.lost:
            follower.lost = True
            self._reports.trip(codes.ARM_LOST, robot, value=silent_ns * 1e-9, limit=self._io.arm_lost_s)
        if self._off_ns and silent_ns > self._off_ns and not follower.off:
            follower.off = True
            self._reports.trip(codes.ARM_LOST_POWER_OFF, robot, value=silent_ns * 1e-9,
                               limit=self._io.arm_lost_power_off_s)

    def _rest(self, follower: TrackedRobot) -> None:
        """No active command: no velocity, and no effort without a position to hold."""
        if self.velocity[follower.place]:
            self._carry_velocity(follower, False)
        self.resting[follower.place] = True
        if follower.in_effort:
            self._note_efforts(follower, b"")
            in_effort = self._pid.effort_mode[follower.axes].copy()
            self.incoming[2, follower.axes] = 0.0
            self._pid.use_effort(follower.axes, False)
            self._stay(follower, in_effort)

    def _note_efforts(self, follower: TrackedRobot, in_effort: bytes) -> None:
        follower.in_effort = in_effort
        self.applies_effort[follower.place] = bool(in_effort)

    def _carry_velocity(self, follower: TrackedRobot, on: bool) -> None:
        self.velocity[follower.place] = on
        if not on:
            self.incoming[1, follower.axes] = 0.0
        self._pid.carry_velocity(follower.axes, on)

    def _stay(self, follower: TrackedRobot, which: Flags) -> None:
        """Hold these actuators at their measured positions; the others keep their held positions."""
        axes = follower.axes
        self.incoming[0, axes] = np.where(which, self._samples.position[axes], self._pid.setpoint_position[axes])
        self.own[follower.place] = self.dirty[0] = True
        self._limit(follower)

    def _limit(self, follower: TrackedRobot) -> None:
        """Apply the limits of one robot; a setpoint of our own outside them stays."""
        axes, robots = follower.axes, self._robots
        free = self._pid.effort_mode[axes] | (not self._record.limits_enforced[follower.robot])
        low, high = np.where(free, -np.inf, robots.lower[axes]), np.where(free, np.inf, robots.upper[axes])
        if self.own[follower.place]:
            low, high = np.minimum(low, self.incoming[0, axes]), np.maximum(high, self.incoming[0, axes])
        self.low[axes], self.high[axes] = low, high
        self.most_step[axes] = np.inf if self.own[follower.place] else self._most[axes]
        self.dirty[0] = True

    def returns(self, position: Floats) -> Flags:
        """Whether each actuator (n,) returns from beyond its limits: it may be far from its setpoint."""
        beyond: Flags = (position < self.low) | (position > self.high)
        beyond &= self._record.at_limit
        return beyond

    def encoders_set(self, robot: int, which: Flags) -> None:
        """These encoders may read something else from this sample on: held actuators are held at their new readings."""
        follower = self._of_robot.get(robot)
        if follower is None or not self._record.pid_enabled[robot]:
            return
        axes = follower.axes
        held = which & ~self._pid.effort_mode[axes]
        if held.any():
            np.copyto(self._pid.setpoint_position[axes], self._samples.position[axes], where=held)
            self._stay(follower, held)

    def _apply(self, now_ns: int) -> None:
        """Clip all positions at once and pass all setpoints to the joint controller."""
        incoming, pid, record = self.incoming, self._pid, self._record
        np.isfinite(incoming, self._finite)
        if b"\0" in self._finite.tobytes():
            self._refuse(now_ns)
        setpoint, wanted = pid.setpoint_position, self._wanted
        np.maximum(incoming[0], self.low, out=wanted)
        np.minimum(wanted, self.high, out=wanted)
        np.not_equal(wanted, incoming[0], record.at_limit)
        step = wanted - setpoint
        late = np.abs(step) > self.most_step
        setpoint[...] = np.where(late, setpoint + np.copysign(self.most_step, step), wanted)
        self.dirty[0] = late.any()  # then it continues in the next cycle
        pid.setpoint_velocity[...] = incoming[1]

    def _refuse(self, now_ns: int) -> None:
        """A setpoint is not finite: switch that robot's controller off before any of it is used."""
        for follower in self.followers:
            bad = ~np.logical_and.reduce(self._finite[:, follower.axes])
            if bad.any():
                self._reports.trip_axes(codes.NOT_FINITE, follower.robot, bad)
                self.enable(follower.robot, False, now_ns)
        self.incoming[~np.isfinite(self.incoming)] = 0.0
        self.dirty[0] = False
