"""A teleoperation's view of its arms, by records and events, with commands by mailboxes; and of the operator."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from trocar.procs.document.walls import AT_WALL
from trocar.procs.kinematics.poses import Array, angle_between
from trocar.procs.node.inputs import Fields, Input
from trocar.procs.node.requests import STREAM_ENDED
from trocar.procs.tables.codes import INVERSE_KINEMATICS
from trocar.procs.tables.manifest import LATE_S
from trocar.procs.teleop.motion_check import MotionCheck
from trocar.shm.mailbox.client import LoopClient
from trocar.shm.mailbox.messages import Reply
from trocar.shm.ring.ring import RingReader

SHOWN_NS: Final = 1_000_000_000  # how long a refusal is shown
LIMIT_SHOWN_NS: Final = 100_000_000  # how long an unreached goal is shown: each goal is answered
LIMITED: Final = ("at its limit", "clipped")  # beginnings of answers to goals that could not be reached
WRENCH_LASTS_S: Final = LATE_S  # forces on masters end by themselves when this process does
IN_REFERENCE_FRAME: Final = 1.0
JAW: Final = "jaw"  # at its limit whenever the gripper is wide open: not reported
NO_FAULTS: Final = frozenset((INVERSE_KINEMATICS.code.encode(),))
"""Codes of errors about a command: it was refused, but the arm has no problem."""
ERROR: Final = 3  # severity of events
HELD: Final = (1, 2)  # control modes: position, trajectory
IN_HAND: Final = b"MANUAL"  # internal state
MAX_GOALS: Final = 1000  # in progress at once; more means that answers were lost
# Setup joints may move a base during following; a larger step from one record to the next is another base.
BASE_STEP_M: Final = 0.005
BASE_STEP_RAD: Final = 0.1


class TeleopArm:
    """One arm. Call `look` once a cycle; the values hold until the next call.

    `whole`: this cycle's record is good; `restarted`: the writer has changed since the last cycle; `rebased`: the base
    frame has changed; `stopped_by`: the program that has stopped the arm since the last look, "": none; `is_in_hand`:
    the clutch on the arm itself is pressed; `refuses_goals`: the arm did not go to the last goal it has answered.

    `is_silent`: no record for too long; `is_enabled`, `is_ready`: ENABLED, and homed, as published; `fault`: why the
    arm is implausible from this cycle on, `doubt`: the same for as long as that lasts, "": plausible; `has_pose`: its
    poses are known and plausible.
    """

    sets_pace = True
    """The teleoperation synchronizes its cycle with this arm's records."""

    def __init__(self, name: str, record: Input, events: RingReader, commands: LoopClient, *, is_master: bool) -> None:
        """`is_master`: the slave follows this arm, so its motion is checked against a hand's; see MotionCheck."""
        self.name, self.record, self.events, self.commands = name, record, events, commands
        field = record.field
        self._state, self._homed, self._busy = field("state"), field("is_homed"), field("is_busy")
        self._sub_state, self._mode, self._known = field("sub_state"), field("control_mode"), field("reference_valid")
        self._pose, self._setpoint_pose = field("measured_cp"), field("setpoint_cp")
        self.twist = field("measured_cv")
        """Twist of the tip in the reference frame (6,)."""
        self.joint_setpoint, self._tool = field("setpoint_position"), field("tool")
        self._simulated, self._base = field("simulated"), self.base_of(field)
        self._stops, self._stopped_by = field("stops"), field("stopped_by")
        self._seen_stops: int | None = None
        self.stopped_by, self._was_free = "", False
        self._has_jaw, self._jaw = field("has_jaw"), field("jaw_setpoint_position")
        self._gripper_valid, self._gripper = field("gripper_valid"), field("gripper_position")
        self._severity, self._code, self._text = (events.field(name) for name in ("severity", "code", "text"))
        self.measured, self.setpoint = np.zeros(7), np.zeros(7)
        """Poses (7,) of the tip in the reference frame, from the last record in which they were known."""
        self.stamp_ns = self._move = self._weight = self._now_ns = 0
        self.whole = self.restarted = self.is_moving = self.has_arrived = False
        self.rebased = self.is_in_hand = self.refuses_goals = False
        self._last_base: Array | None = None
        self._goals: set[int] = set()
        self._refusal, self._refused_ns = "", -SHOWN_NS
        self._ended_ns = -SHOWN_NS
        self._limit, self._limited_ns, self._at_wall = "", -LIMIT_SHOWN_NS, False
        self.is_silent, self.fault, self.doubt = True, "", ""
        self.is_enabled = self.is_ready = self.has_pose = self.is_known = self._is_busy = False
        self.check = MotionCheck(name, self._pose, self.twist) if is_master else None

    # inputs

    def look(self, now_ns: int) -> None:
        """Read the newest record and the replies to commands."""
        self._now_ns = now_ns
        self.whole, self.rebased, self.stopped_by = self.record.look(now_ns), False, ""
        self.restarted, self.stamp_ns = self.record.restarted, self.record.stamp_ns
        self.is_silent = not self.record.fresh
        if self.restarted:
            self._seen_stops = None
            self.is_moving = self.has_arrived = False
            if self.check is not None:
                self.check.forget()
        if self.whole:
            self.is_enabled = self._state.item() == b"ENABLED"
            self.is_ready = self.is_enabled and bool(self._homed)
            self._is_busy = bool(self._busy)
            self.is_in_hand = self._sub_state.item() == IN_HAND
            self._was_free = self._was_free or not self.is_held
            self._look_at_base()
            self._look_at_stops()
            pose, setpoint = self._pose, self._setpoint_pose
            self.is_known = bool(self._known) and math.isfinite(pose.dot(pose) + setpoint.dot(setpoint))
            if self.is_known:
                self.measured[...], self.setpoint[...] = pose, setpoint
        if self.check is not None:
            objection = self.objection() if self.whole else ""
            self.check.look(self.stamp_ns, now_ns, known=self.is_known, objection=objection)
            self.fault, self.doubt = self.check.fault, self.check.doubt
        self.has_pose = self.is_known and not self.doubt
        for answer in self.commands.poll():
            self._hear(answer)

    def base_of(self, field: Fields) -> Array:
        """The field with the pose of the arm's base (7,) in the reference frame."""
        return field("base_frame")

    def _look_at_stops(self) -> None:
        """Teleoperations send no stops: all are from other programs."""
        stops = int(self._stops)
        if self._seen_stops not in (None, stops):
            self.stopped_by = bytes(self._stopped_by.item()).decode(errors="replace")
        self._seen_stops = stops

    def _look_at_base(self) -> None:
        last, base = self._last_base, self._base
        if last is None:
            self._last_base = base.copy()
        elif last.tobytes() != base.tobytes():
            self.rebased = not (math.dist(last[:3], base[:3]) <= BASE_STEP_M
                                and angle_between(last, base) <= BASE_STEP_RAD)
            last[...] = base

    def objection(self) -> str:
        """Why the newest record is implausible, except for a jump; "": it is plausible."""
        return ""

    @property
    def is_busy(self) -> bool:
        """Whether a transition or a move is in progress."""
        return self._is_busy or self.is_moving

    @property
    def is_kinematic(self) -> bool:
        """Whether there is no robot: forces do not move the arm, only position commands do."""
        return bool(self._simulated)

    @property
    def is_held(self) -> bool:
        """Whether the arm holds or follows positions; never true for a kinematic arm, which always does."""
        return self._mode.item() in HELD and not self._simulated

    @property
    def is_taken(self) -> bool:
        """Whether another program moved the arm, or made it hold, after it was released."""
        return self._was_free and self.is_held

    @property
    def reported(self) -> str:
        """The arm's state in words."""
        return bytes(self._sub_state.item()).decode(errors="replace") or "not there"

    @property
    def tool(self) -> str:
        """The attached instrument."""
        return bytes(self._tool.item()).decode(errors="replace")

    @property
    def has_jaw(self) -> bool:
        """Whether an instrument with a jaw is attached."""
        return bool(self._has_jaw)

    @property
    def jaw(self) -> float:
        """Setpoint of the jaw."""
        return float(self._jaw)

    @property
    def gripper(self) -> float:
        """Angle of a master's gripper, NaN: none."""
        return float(self._gripper) if self._gripper_valid else float("nan")

    @property
    def refusal(self) -> str:
        """Reason for a recent refusal of a command, "": none."""
        return self._refusal if self._now_ns - self._refused_ns < SHOWN_NS else ""

    @property
    def has_ended_stream(self) -> bool:
        """Whether the arm has just ended our stream of goals; it refuses them until the stream has paused."""
        return self._now_ns - self._ended_ns < LIMIT_SHOWN_NS

    @property
    def limit(self) -> str:
        """Why the arm could not reach a recent goal, "": it could."""
        return self._limit if self._now_ns - self._limited_ns < LIMIT_SHOWN_NS else ""

    @property
    def is_at_wall(self) -> bool:
        """Whether a wall keeps it from the newest goal that it has answered, a moment ago."""
        return self._at_wall and bool(self.limit)

    def errors(self) -> list[str]:
        """Errors of the arm since the last call."""
        found = []
        while self.events.next():
            if self._severity.item() == ERROR and self._code.item() not in NO_FAULTS:
                found.append(bytes(self._text.item()).decode(errors="replace"))
        return found

    # commands

    def send(self, name: str, values: Sequence[float] | Array = (), text: str = "") -> int:
        """Send a command; returns its number, 0: the arm's mailbox is full."""
        return self.commands.send(name, values, text)

    def pursue(self, name: str, values: Array) -> int:
        """Send a goal of a stream; if the arm refuses it, `refuses_goals` until one is accepted."""
        number = self.send(name, values)
        if number:
            if len(self._goals) >= MAX_GOALS:
                self._goals.clear()
            self._goals.add(number)
        return number

    def expect(self, done_to: int, waiting: Sequence[int], pursued: Sequence[int]) -> None:
        """The native library has sent commands: those up to a number are done, answers to others are still to come.

        `pursued`: those that it has sent as `pursue` does, and perhaps older ones.
        """
        self.commands.note(waiting)
        self._goals = {number for number in self._goals if number > done_to}.union(set(waiting).intersection(pursued))

    def move(self, pose: Array) -> None:
        """Move the tip to a pose (7,); `is_moving` until the reply on its end, then `has_arrived` or not."""
        self._move = self.send("move_cp", pose)
        self.is_moving, self.has_arrived = bool(self._move), False

    def leave(self) -> None:
        """Hold, if the arm follows our commands; another program that controls it is not disturbed."""
        self.send("end_stream")

    def let_go(self) -> None:
        """Release the arm: only efforts against its weight, if it is ready for commands."""
        self._was_free = False
        if self.is_ready and not self.is_silent:
            self._weight = self.send("use_gravity_compensation", (1.0,))  # first: the arm has no other support then
            self.send("body/servo_cf", (0.0,) * 6)

    def _hear(self, answer: Reply) -> None:
        if answer.id == self._weight:
            self._weight = 0
            return  # some arms have no model of their weight
        if answer.id in self._goals:
            self._goals.discard(answer.id)
            self._at_wall = AT_WALL in answer.text
            self.refuses_goals = answer.outcome in ("refused", "failed")
            if answer.text.partition(": ")[2].startswith(STREAM_ENDED):
                self._ended_ns = self._now_ns
        if answer.outcome in ("refused", "failed"):
            self._refusal, self._refused_ns = f"{self.name}: {answer.text}", self._now_ns
        elif answer.text:
            begins, _, why = answer.text.partition(": ")
            _, _, wall = answer.text.partition(AT_WALL)
            if wall:
                self._limit, self._limited_ns = f"{self.name} is at wall {wall}", self._now_ns
            elif begins in LIMITED and why != JAW:
                self._limit, self._limited_ns = f"{self.name} at its limit: {why}", self._now_ns
        if answer.id == self._move:
            self.is_moving = answer.outcome == "accepted"
            self.has_arrived = answer.outcome == "done"


class BaseFrame:
    """The slave's base frame when the base is movable: the tip of another arm, or of a setup arm."""

    doubt = ""

    def __init__(self, name: str, record: Input, setup: int | None = None) -> None:
        """`setup`: the index of the setup arm, if `record` is that of setup joints."""
        self.name, self.record = name, record
        self.measured = record.field("measured_cp")
        self.known = record.field("reference_valid" if setup is None else "base_valid")
        if setup is not None:
            self.measured, self.known = self.measured[setup], self.known[setup : setup + 1]
        self.seen = np.zeros(7)
        self.is_known = False

    def look(self, now_ns: int) -> None:
        """Read the record once a cycle."""
        if self.record.look(now_ns):
            self.is_known = bool(self.known.item()) and math.isfinite(self.measured.dot(self.measured))
            if self.is_known:
                self.seen[...] = self.measured

    @property
    def pose(self) -> Array | None:
        """The pose (7,); None: not known."""
        return self.seen if self.is_known and self.record.fresh else None


class Operator:
    """The operator, as the console reports.

    `absence` is why the operator counts as absent, "": present; always present without a console (None). `clutch`: from
    the console's record, in case its commands were missed.
    """

    def __init__(self, console: str, record: Input | None) -> None:
        self.console, self.record = console, record
        self.absence, self.is_silent, self.clutch = "", record is not None, False
        if record is not None:
            self._valid, self._present = record.field("valid"), record.field("operator_present")
            self._clutch = record.field("clutch")

    def look(self, now_ns: int) -> None:
        """Once a cycle; a restarted console counts as silent for that cycle."""
        if self.record is None:
            return
        whole = self.record.look(now_ns)
        self.is_silent = self.record.restarted or not self.record.fresh
        if whole:
            self.clutch = bool(self._clutch)
        if self.is_silent:
            self.absence = f"{self.console} is silent"
        elif whole and not self._valid:
            self.absence = f"{self.console} gets no data from its inputs"
        elif whole:
            self.absence = "" if self._present else f"{self.console} detects no operator"
