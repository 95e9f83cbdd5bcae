"""What states and commands of an arm share: the joints, where they are to go, and who waits for it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from procs.arm.cartesian import Cartesian
from procs.arm.duties import Duties
from procs.arm.efforts import Efforts
from procs.arm.gravity import Weight
from procs.arm.joints import ARM_JOINTS, Joints
from procs.arm.machine import Machine
from procs.arm.motion import Mode, Motion, Space
from procs.arm.readings import Readings
from procs.arm.record import ArmRecord, SetpointRecord
from procs.arm.supervision import Generations
from procs.lib.document import Arm
from procs.lib.requests import Reports, Request

Array = NDArray[np.float64]

CLIP_EPISODE_NS: Final = 500_000_000
SAID_NS: Final = 2_000_000_000
STREAM_NS: Final = 100_000_000  # a goal older than this is of no stream
SEEN_NS: Final = 20_000_000  # who streams goals has seen by then that the tip or the base is another one
NEVER_NS: Final = 1 << 62
MOVE, JAW_MOVE = "move", "jaw move"


class Refused(Exception):
    """A command that will not be carried out; the text says why."""


class Control:
    """The parts of one arm and the verbs that change its motion; `now_ns` is this cycle's time."""

    def __init__(self, arm: Arm, joints: Joints, io: Readings, duties: Duties, machine: Machine, reports: Reports,
                 cartesian: Cartesian, record: ArmRecord, setpoint: SetpointRecord,
                 fault_text: Callable[[int], str]) -> None:
        self.arm, self.joints, self.io, self.duties, self.machine = arm, joints, io, duties, machine
        self.reports, self.cartesian, self.record, self.setpoint = reports, cartesian, record, setpoint
        self.fault_text = fault_text
        self.motion, self.efforts = Motion(joints, arm.jerk_time_s), Efforts(cartesian)
        self.gravity = Weight(arm, ARM_JOINTS[arm.type])
        self.driving: Generations | None = None
        """The joint controller was seen on, and follows us."""
        self.is_played = arm.simulation != "NONE"
        """KINEMATIC: io plays the robot."""
        self.must_bias = True
        self.homed_generation = 0
        self.held = False
        """A successor found the joint controller on, in no state for it: it just holds."""
        self.now_ns = 0
        self.posed_ns, self._poses_from_ns = -STREAM_NS, 0
        """When a goal of a stream of poses was last followed."""
        self._moves: dict[str, Request] = {}
        self._clipped_ns = -SAID_NS
        self._said_ns: dict[str, int] = {}
        self.use(joints)

    def use(self, joints: Joints) -> None:
        """Another joint space, at rest where the actuators are kept."""
        kept = self.joints.to_actuator @ self.here if self.driving is not None else None
        self.mistrust_poses()
        self.joints = joints
        self.io.use(joints)
        self.motion.use(joints)
        self.gravity.use(joints.size)
        for part in (self.cartesian, self.record, self.setpoint):
            part.use(joints)
        self.motion.hold(self.io.setpoint if kept is None else joints.to_joint @ kept, Mode.NONE)
        self.goal, self._velocity = np.zeros(joints.size), np.zeros(joints.size)
        self._clipped = np.zeros(joints.size, dtype=np.bool_)

    def mistrust_poses(self) -> None:
        """The tip or the base is another one: goals of a stream that are on their way were worked out for the old."""
        if self.now_ns - self.posed_ns < STREAM_NS:
            self._poses_from_ns = self.now_ns + SEEN_NS

    @property
    def trusts_poses(self) -> bool:
        """Goals are for the tip and the base that there are."""
        return self.now_ns >= self._poses_from_ns

    # what is told

    def status(self, text: str) -> None:
        """Tell something about this arm."""
        self.reports.status(f"{self.arm.name}: {text}", self.arm.name)

    def warn(self, code: str, text: str, every_ns: int = 0) -> None:
        """Warn of something about this arm; the same code again only after `every_ns`."""
        if self.now_ns - self._said_ns.get(code, -NEVER_NS) >= every_ns:
            self._said_ns[code] = self.now_ns
            self.reports.warning(code, f"{self.arm.name}: {text}", self.arm.name)

    def error(self, code: str, text: str, every_ns: int = 0) -> None:
        """Tell an error of this arm that does not stop it; the same code again only after `every_ns`."""
        if self.now_ns - self._said_ns.get(code, -NEVER_NS) >= every_ns:
            self._said_ns[code] = self.now_ns
            self.reports.error(code, f"{self.arm.name}: {text}", self.arm.name)

    # where the joints are to go; `goal` is what the command at hand works on

    def take_goal(self) -> Array:
        """`goal` := where all joints are kept now; a servo command then changes its own part of it."""
        self.goal[...] = self.here
        return self.goal

    @property
    def here(self) -> Array:
        """Where the joints are kept; in effort mode where io would keep them."""
        return self.io.setpoint if self.motion.mode is Mode.EFFORT else self.motion.goal

    @property
    def target(self) -> Array:
        """Where the joints are going now; in effort mode where io would keep them."""
        return self.io.setpoint if self.motion.mode is Mode.EFFORT else self.motion.target

    def take_target(self) -> Array:
        """`goal` := where the joints are going now."""
        if self.motion.mode is Mode.EFFORT:
            self.motion.hold(self.io.setpoint)
        self.goal[...] = self.motion.target
        return self.goal

    def _clip(self) -> tuple[NDArray[np.bool_], str]:
        """Bring `goal` into the limits; what was clipped is in the answer, and once an episode a warning."""
        outside = self.joints.clip(self.goal, self.here)
        if outside is self.joints.none or not outside.any():
            return outside, ""
        if self.now_ns - self._clipped_ns >= CLIP_EPISODE_NS:
            self._clipped[...] = False
        self._clipped_ns = self.now_ns
        names = self.joints.named(outside)
        if (outside & ~self._clipped).any():
            self._clipped |= outside
            self.warn("clipped", f"clipped to the joint limits: {names}")
        return outside, f"clipped: {names}"

    def follow(self, space: Space, velocity: Array | None = None) -> str:
        """Follow `goal` from now on, with a velocity feed of the arm's joints (count,)."""
        outside, text = self._clip()
        if velocity is not None:
            velocity = self._feed(velocity)
            if text:
                velocity[outside] = 0.0
        self.motion.space = space
        if self.motion.servo(self.goal, velocity, self.now_ns):
            self.move_ended(False, "replaced by a servo command")
        return text

    def drift(self, velocity: Array) -> str:
        """Go at a velocity of the arm's joints (count,)."""
        self._feed(velocity)
        if self.motion.mode is Mode.EFFORT:
            self.motion.hold(self.io.setpoint)
        self.motion.space = Space.JOINT
        if self.motion.drift(self._velocity, self.now_ns):
            self.move_ended(False, "replaced by a servo command")
        return ""

    def _feed(self, velocity: Array) -> Array:
        """Velocities of all joints (size,) from those of the arm's (count,)."""
        feed = self._velocity
        feed[...] = 0.0
        feed[: len(velocity)] = velocity
        if self.joints.paired is not None:
            feed[...] = self.joints.paired @ feed
        return feed

    def adjust(self) -> str:
        """Follow `goal`, of which only the jaw has changed."""
        _, text = self._clip()
        if self.motion.adjust(self.goal, self.now_ns):
            self.move_ended(False, "replaced by a servo command")
        return text

    def push(self, space: Space, effort: Array, which: NDArray[np.bool_] | None = None) -> None:
        """Apply efforts (size,) instead of following positions, to joints `which`; see `efforts` for their law."""
        self.motion.space = space
        if self.motion.push(effort, which):
            self.move_ended(False, "replaced by an effort command")

    def move(self, request: Request, space: Space, what: str = MOVE) -> None:
        """Move to `goal`; answers the request, now and at the end. Refused when it cannot be planned."""
        _, text = self._clip()
        reason = self.motion.move(self.goal, self.io.velocity, self.now_ns)
        if reason:
            raise Refused(f"{request.name}: {reason}")
        self.motion.space = space
        replaced = self._moves.pop(what, None)
        if replaced is not None:
            replaced.fail(f"replaced by a newer {what}")
        self._moves[what] = request
        request.accept(text)
        self.machine.moving = True
        self.machine.publish()

    def move_ended(self, reached: bool, reason: str = "") -> None:
        """The move that ran has ended, at its goal or before it, for `reason`."""
        machine = self.machine
        if not machine.moving:
            return  # a move of the arm's own, nobody waits for it
        machine.moving = False
        for request in self._moves.values():
            if reached:
                request.done()
            else:
                request.fail(reason)
        self._moves.clear()
        machine.reports.goal_reached(reached)
        machine.publish()

    def stop(self, position: Array, mode: Mode, reason: str) -> None:
        """Whatever runs, stay at `position` (size,) from now on."""
        if self.motion.hold(position, mode):
            self.move_ended(False, reason)
