"""The parts that states and commands of an arm share: the joints, their goals, and the clients that wait."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.arm.cartesian import Cartesian
from trocar.procs.arm.clipping import Clipping
from trocar.procs.arm.context import ArmContext
from trocar.procs.arm.effort_limits import EffortGuard, EffortLimits
from trocar.procs.arm.efforts import Efforts, Law
from trocar.procs.arm.governor import LATE_S, MAX_LAG_S
from trocar.procs.arm.gravity import Weight
from trocar.procs.arm.io_requests import IoRequests
from trocar.procs.arm.joints import JointSpace, joints
from trocar.procs.arm.machine import ArmStates
from trocar.procs.arm.motion import EFFORT, NONE, POSITION, Mode, Motion, Space
from trocar.procs.arm.readings import ArmReadings
from trocar.procs.arm.record import ArmRecord, SetpointRecord
from trocar.procs.arm.reports import REPORT_NS, ArmReports
from trocar.procs.arm.setup_base import BaseSteps
from trocar.procs.arm.states import WALLED
from trocar.procs.arm.supervision import Generations
from trocar.procs.arm.walls import Walls
from trocar.procs.document.system import ArmConfig
from trocar.procs.document.walls import AT_WALL
from trocar.procs.kinematics.poses import Array
from trocar.procs.node.requests import ANSWERED, CommandRefused
from trocar.procs.node.streams import JAW, StreamKind, Streams
from trocar.procs.tables import codes
from trocar.procs.tables.arm_types import ARM_TYPES
from trocar.shm.mailbox.received import Request

ARRIVE_NS: Final = 500_000_000  # time for joints to arrive at the goal after the end of a move's trajectory
MOVE, JAW_MOVE = "move", "jaw move"


class Control(ArmReports):
    """The parts of one arm and the functions that change its motion; `now_ns` is this cycle's time."""

    def __init__(self, arm: ArmConfig, around: ArmContext, machine: ArmStates) -> None:
        super().__init__(arm.name, around.reports)
        self.arm, self.machine = arm, machine
        self.fault_report = around.fault_report
        self.joints = joints(arm, arm.tool if arm.tool_detection == "FIXED" else None)
        self.io = ArmReadings(around.field, around.robot, around.first_axis, self.joints)
        self.cartesian = Cartesian(around.state, self.io, arm.name)
        self.record = ArmRecord(around.state, self.io, simulated=arm.simulation != "NONE")
        self.io_requests = IoRequests(self.io, around.setpoint, around.sender, arm.robot,
                                      lambda text: self.report(codes.IO_REFUSED, text), has_brakes=around.has_brakes)
        self.setpoint = SetpointRecord(around.setpoint, ARM_TYPES[arm.type].actuators)
        self.motion = Motion(self.joints, arm.jerk_time_s)
        self._effort_limits = EffortLimits(around.motors, self.joints)
        self.efforts = Efforts(self.cartesian, self._effort_limits, self.joints.size, arm.effort_timeout_s)
        self.walls = Walls(arm, around, self, self.cartesian, lambda: machine.state in WALLED)
        self.guard = EffortGuard(arm.effort_speed_ratio, arm.effort_zone_ratio)
        self.streams, self._base_steps = Streams(simulated=around.simulated), BaseSteps()
        self.gravity = Weight(arm)
        self.driving: Generations | None = None
        """Set once the joint controller was seen on and following our setpoints."""
        self.is_kinematic = arm.simulation != "NONE"
        """KINEMATIC: io replaces the robot."""
        self.must_bias = True
        self.homed_generation = 0
        self.held = False
        """After a restart the joint controller was on, in a state that does not use it: it only holds."""
        self._moves: dict[str, tuple[Request, str]] = {}
        """Moves in progress, with the clipped parts of their goals."""
        self.use(self.joints)

    def use(self, joints: JointSpace) -> None:
        """Use another joint space, at rest at the held actuator positions."""
        kept = self.joints.to_actuator @ self.here if self.driving is not None else None
        self.streams.end("the instrument was changed")
        self.joints = joints
        self.io.use(joints)
        self.motion.use(joints)
        self.gravity.use(joints.size)
        self._effort_limits.use(joints)
        self.efforts.use(joints.size)
        self.guard.use(joints, self._effort_limits.most)
        self.cartesian.use(joints)
        self.record.use(joints)
        self.setpoint.use(joints, self.motion, self.gravity.effort, self.io.position)
        self.walls.use(joints)
        self.place_walls()
        self.motion.hold(self.io.setpoint if kept is None else joints.to_joint @ kept, NONE)
        self.goal, self._velocity = self.motion.asked, np.zeros(joints.size)
        self._clipped, self._efforts_clipped = Clipping(joints.size), Clipping(joints.size)

    def set_base(self, base: Array | None) -> None:
        """The base has moved, see `Cartesian.set_base`; a step ends streams in the base's frame."""
        why = self._base_steps.step(base, self.now_ns)
        self.cartesian.set_base(base)
        self.place_walls()
        motion = self.motion
        springs = motion.mode is EFFORT and self.efforts.law is Law.IMPEDANCE
        if why and motion.space is Space.CARTESIAN and (motion.mode is POSITION or springs):
            self.end_streams(why, (StreamKind.POSITION, StreamKind.EFFORT))

    def place_walls(self) -> None:
        """Walls, or the base frame, have changed."""
        self.walls.place(self.motion.governor)

    # goals of the joints; `goal` belongs to the current command

    def take_goal(self) -> Array:
        """`goal` := the target of all joints; a servo command then changes its own part."""
        self.goal[...] = self.motion.target if self.motion.mode is POSITION else self.here
        if self.motion.jaw_streams:
            self.goal[-1] = self.motion.target[-1]
        return self.goal

    @property
    def here(self) -> Array:
        """Where the joints are held; in effort mode, where io would hold them."""
        return self.io.setpoint if self.motion.mode is EFFORT else self.motion.goal

    @property
    def target(self) -> Array:
        """Where the joints are going; in effort mode, where io would hold them."""
        return self.io.setpoint if self.motion.mode is EFFORT else self.motion.target

    def take_target(self) -> Array:
        """`goal` := the present target of the joints."""
        self._end_efforts()
        self.goal[...] = self.motion.target
        if self.motion.jaw_moves:
            self.goal[-1] = self.motion.jaw_goal
        return self.goal

    def _clip(self) -> NDArray[np.bool_]:
        """Clip `goal` to the limits; returns the joints (size,) that were outside."""
        return self.joints.clip(self.goal, self.here)

    def _say_clipped(self, outside: NDArray[np.bool_], asked: Array | None = None) -> str:
        """Text for the answer about clipped joints, and once an episode a warning; `asked`: also the values before and
        after.
        """
        if outside is self.joints.none or not outside.any():
            return ""
        names = self.joints.named(outside) if asked is None else self.joints.changed(outside, asked, self.goal)
        if self._clipped.is_news(outside, self.now_ns):
            self.report(codes.CLIPPED, f"clipped to the joint limits: {names}")
        return f"clipped: {names}"

    def _take_goal(self, name: str, *, of_arm: bool) -> NDArray[np.bool_]:
        """Clip `goal`, from a stream of commands `name`, to the limits; returns the joints that were outside.

        CommandRefused if it is too far away; a running stream ends there. `of_arm`: not of its jaw.
        The first goal of a stream is checked before clipping, because a wrong number may also be close to a limit. A
        running stream may pass a limit, and its goals are checked after clipping.
        """
        governor, joints = self.motion.governor, self.joints
        if governor.most.item() > LATE_S and self._is_streaming:
            self._report_slow()
        lag_s, axis = self._lag(of_arm)
        must_clip, outside = not governor.is_inside or joints.paired is not None, joints.none
        if lag_s <= MAX_LAG_S and not must_clip:
            return outside
        is_running = self._is_streaming
        if must_clip and is_running:
            outside = self._clip()
            lag_s, axis = self._lag(of_arm)
        if lag_s > MAX_LAG_S:
            allowed, unit = governor.speed[axis], joints.unit(axis)
            raise self.jump(name, f"{joints.name(axis)} is {lag_s * allowed:.3g} {unit} from the setpoint; "
                                  f"{allowed * MAX_LAG_S:.3g} {unit} is allowed", "move there first (move_jp, move_cp)")
        return self._clip() if must_clip and not is_running else outside

    def _lag(self, of_arm: bool) -> tuple[float, int]:
        """Distance to `goal` in s at the largest speed, and its joint; at a wall, from the last goal."""
        usual = self.motion.governor.lag()
        if not self._is_streaming:
            self.walls.forget()
        ways = self.walls.ways_from_last(self.here, self.goal) if of_arm else None
        return usual if ways is None else (float(ways.max()), int(ways.argmax()))

    @property
    def _is_streaming(self) -> bool:
        motion, asking = self.motion, self.streams.asking
        is_jaw = motion.jaw_streams and asking is not None and asking.kind is JAW
        return (is_jaw or motion.mode is POSITION) and self.streams.is_running(self.now_ns)

    def jump(self, name: str, why: str, remedy: str) -> CommandRefused:
        """The exception for a goal of a stream of commands `name` that is too far away; a running stream ends."""
        streams = self.streams
        if self._is_streaming and streams.asking is not None:
            streams.end_one(streams.asking, f"it jumped: {why}")
            self._hold(why)
        return self.refusal(codes.STREAM_JUMP, name, f"{why}: {remedy}", REPORT_NS, has_remedy=True)

    def _report_slow(self) -> None:
        governor = self.motion.governor
        axis = int(governor.behind.argmax())
        self.report_episode(codes.SPEED_LIMITED, f"{self.joints.name(axis)} follows at its largest speed, "
                                                 f"{governor.speed[axis]:g} {self.joints.unit(axis)}/s")

    def watch_lag(self) -> None:
        """Once a cycle for a stream of velocities: end it if the joints cannot go as fast."""
        lag_s = self.motion.governor.most.item()
        if lag_s > MAX_LAG_S:
            axis = int(self.motion.governor.behind.argmax())
            why = (f"{self.joints.name(axis)} is commanded faster than {self.motion.governor.speed[axis]:g} "
                   f"{self.joints.unit(axis)}/s")
            self.report(codes.STREAM_JUMP, why, REPORT_NS)
            self.end_streams(f"it jumped: {why}", (StreamKind.POSITION,))
        elif lag_s > LATE_S:
            self._report_slow()

    def end_streams(self, why: str, kinds: Iterable[StreamKind]) -> None:
        """Hold, and refuse these streams until they have paused."""
        self.streams.end(why, kinds)
        self._hold(why)

    def _hold(self, why: str) -> None:
        if self.motion.jaw_streams:
            self.motion.adjust(self.here, moves=True)  # only the jaw holds
        else:
            self.stop(self.here, POSITION, why)
        self.status(f"stream ended: {why}")

    def follow(self, name: str, space: Space, velocity: Array | None = None) -> str:
        """Follow `goal`, from a stream of commands `name`, with a velocity feed for the arm's joints (count,)."""
        outside = self._take_goal(name, of_arm=True)
        text = self._say_clipped(outside)
        wall = self.walls.allow(self.here, self.goal, self.now_ns)
        if velocity is not None:
            velocity = self._feed(velocity)
            if text:
                velocity[outside] = 0.0
            if wall:
                velocity[...] = 0.0
        if wall:
            self.report_episode(codes.AT_WALL, AT_WALL + wall)
            text = "; ".join(filter(None, (text, AT_WALL + wall)))
        self.motion.space = space
        self._end_efforts()
        self.motion.servo(self.goal, velocity, self.now_ns, jaw_moves=self._leave_jaw())
        return text

    def _leave_jaw(self) -> bool:
        """A stream of the arm replaces its move; returns whether a move of the jaw continues beside it."""
        if JAW_MOVE not in self._moves:
            self.move_ended(False, "replaced by a servo command")
            return False
        self._replace(MOVE, "replaced by a servo command")
        return True

    def drift(self, velocity: Array) -> str:
        """Move at a velocity of the arm's joints (count,)."""
        self._feed(velocity)
        self._end_efforts()
        self.walls.forget()
        self.motion.space = Space.JOINT
        self.motion.drift(self._velocity, self.now_ns, jaw_moves=self._leave_jaw())
        return ""

    def _end_efforts(self) -> None:
        if self.motion.mode is EFFORT:
            self.motion.hold(self.io.setpoint)

    def _feed(self, velocity: Array) -> Array:
        """Velocities of all joints (size,) from those of the arm's joints (count,)."""
        feed = self._velocity
        feed[...] = 0.0
        feed[: len(velocity)] = velocity
        if self.joints.paired is not None:
            feed[...] = self.joints.paired @ feed
        return feed

    def adjust(self, name: str) -> str:
        """Follow `goal`, from a stream of commands `name` that changed only the jaw; a move of the arm continues."""
        outside = self._take_goal(name, of_arm=False)
        text = self._say_clipped(outside)
        self._end_efforts()
        moves = MOVE in self._moves
        self.motion.adjust(self.goal, moves=moves)
        if moves:
            self._replace(JAW_MOVE, "replaced by a servo command")
        else:
            self.move_ended(False, "replaced by a servo command")
        return text

    def push(self, space: Space, which: NDArray[np.bool_] | None = None) -> Efforts:
        """Apply efforts instead of positions, to joints `which`; the caller sets them in the returned object."""
        self.motion.space = space
        if self.motion.mode is not EFFORT:
            self.efforts.rest()
            self.guard.begin()
        self.motion.push(which)
        self.move_ended(False, "replaced by an effort command")
        return self.efforts

    def pushed(self) -> str:
        """The answer to an effort command."""
        self.efforts.step(self.now_ns)
        return self._say_efforts_clipped()

    def feed(self, wrench: Array) -> str:
        """Add a wrench (6,), in axes of the reference frame, to position control; it lasts as long as efforts do."""
        self.motion.add(self.efforts.feed(wrench), self.efforts.timeout_at(self.now_ns, wrench))
        return self._say_efforts_clipped()

    def step_efforts(self) -> None:
        """Put the efforts of this cycle into `motion`."""
        motion = self.motion
        if motion.mode is EFFORT:
            self.efforts.step(self.now_ns)
            motion.effort[...] = self.efforts.effort
            self._say_efforts_clipped()
        elif self.now_ns >= motion.feed_end_ns:
            motion.end_feed()
            self.report_episode(codes.EFFORT_TIMEOUT,
                                f"no new wrench for {self.arm.effort_timeout_s:g} s; the wrench has ended")

    def _say_efforts_clipped(self) -> str:
        outside = self.efforts.clipped
        if outside is self.joints.none:
            return ""
        names = self.joints.named(outside)
        if self._efforts_clipped.is_news(outside, self.now_ns):
            self.report(codes.EFFORT_CLIPPED, f"efforts clipped to the limits of motors and joints: {names}")
        return f"clipped: {names}"

    def move(self, request: Request, space: Space, what: str = MOVE) -> str:
        """Move to `goal`; answers the request, now and at the end. CommandRefused if planning fails."""
        asked = self.goal.copy()
        outside = self._clip()
        text = self._say_clipped(outside, asked)
        motion, now_ns, is_jaw = self.motion, self.now_ns, what == JAW_MOVE
        if why := "" if is_jaw else self.walls.objection(self.here, self.goal):
            raise self.refusal(codes.WALL_IN_THE_WAY, request.name, why, REPORT_NS)
        reason = (motion.move_jaw(self.goal[-1].item(), now_ns) if is_jaw and motion.is_streaming(now_ns)
                  else motion.move(self.goal, self.io.velocity, now_ns, jaw=is_jaw))
        if reason:
            raise CommandRefused(reason)
        self.motion.space = space
        self._replace(what, f"replaced by a newer {what}")
        self._moves[what] = request, text
        request.accept(text)
        self.machine.moving = True
        self.machine.publish()
        return ANSWERED

    def _replace(self, what: str, reason: str) -> None:
        """Answer a move in progress that another command replaces."""
        replaced, _ = self._moves.pop(what, (None, ""))
        if replaced is not None:
            replaced.fail(reason)

    def short(self) -> str:
        """After the trajectory of a move: joints that have not arrived at their goals, and by how much; "": all have.

        The jaw counts in its own moves only, and in these no other joint.
        """
        goal, measured = self.motion.goal, self.io.position
        if JAW_MOVE not in self._moves:
            if MOVE in self._moves and self.joints.has_jaw:
                goal = np.append(goal[:-1], measured[-1])
        elif MOVE not in self._moves:
            goal = np.append(measured[:-1], goal[-1])
        return self.joints.short(goal, measured)

    def watch_move(self) -> None:
        """Once a cycle: a move ends when all joints have arrived, or ARRIVE_NS after its trajectory."""
        if self.motion.stopped:
            self.move_ended(False, f"wall {self.walls.stopped_by} is in the way")
        if not self.machine.moving or self.motion.moving or self.motion.jaw_moves:
            return
        short = self.short()
        if not short or self.now_ns >= self.motion.end_ns + ARRIVE_NS:
            self.move_ended(True, short)

    def move_ended(self, at_end: bool, reason: str = "") -> None:
        """The move has ended: after its trajectory, perhaps `short` of its goal for a `reason`, or before."""
        machine = self.machine
        if not machine.moving:
            return  # no move, or one of the arm's own without a client
        machine.moving = False
        for request, text in self._moves.values():
            if at_end:  # this answer also reports a clipped goal
                request.done("; ".join(part for part in (text, reason) if part))
            else:
                request.fail(reason)
        if at_end and reason:
            self.status(f"the move ended {reason}")
        self._moves.clear()
        machine.reports.goal_reached(at_end and not reason)
        machine.publish()

    def stop(self, position: Array, mode: Mode, reason: str) -> None:
        """End all motion and stay at `position` (size,) from now on."""
        self.walls.forget()
        self.motion.hold(position, mode)
        self.move_ended(False, reason)
