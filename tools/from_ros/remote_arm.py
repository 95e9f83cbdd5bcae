"""An arm on ROS as its messages show it: each message is checked, and the arm is there only while good poses arrive.

Time is an argument. `take` the messages, `look` once a period; values are None while they are not known.

The arm is there after half a second of good `measured_cp`. 0.1 s of silence, or a wrong message in `measured_cp`, is a
loss: the arm needs half a second of good poses again, and its frame may be another one. (Teleoperations stop earlier:
30 ms after the last record.) A program that repeats the same stamp has a stalled arm, which counts as silence. A stamp
of 0 means that the arm does not know its pose.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from cyclonedds.idl import IdlStruct

from trocar.procs.crtk.joint_order import in_order
from trocar.procs.document.bridges import RosArm
from trocar.procs.kinematics.poses import Array, normalised
from trocar.procs.ros_messages.command_messages import frame_of, pose_numbers, twist_numbers
from trocar.procs.ros_messages.messages import Bool, JointStates, OperatingState, PoseStamped, String, TwistStamped
from trocar.procs.tables.manifest import LATE_S
from trocar.tools.client.instance import STATES

STEADY_NS: Final = 500_000_000
"""Good poses for this long: the arm is there."""
MIN_POSES: Final = round(STEADY_NS * 1e-9 / LATE_S)
"""In that time: fewer mean that it publishes too seldom."""
LAG_NS: Final = 100_000_000
"""A longer silence is a loss; a message may be late by this much, and values be older than the pose."""
WINDOW_NS: Final = 60_000_000_000
"""Delays are compared with the least one of the last one to two minutes: clocks of two machines drift."""
SAME_NS: Final = 100_000
"""Stamps that differ less are of one measurement: each message of a stalled arm may convert its time to another one."""
SAME_CLOCK_NS: Final = 86_400_000_000_000
"""Stamps that differ more from the time of day are simulated time, in which a delay is not known."""
MAX_JOINTS: Final = 8
MAX_TEXT: Final = 200
POSE: Final = "measured_cp"
ECM_JOINTS: Final = ("yaw", "pitch", "insertion", "roll")
SECOND_NS: Final = 1_000_000_000


@dataclass(frozen=True, slots=True)
class RemoteTopic:
    """A topic of the arm; `latched`: late subscribers get its last message; `types`: arms that have it, empty: all."""

    name: str
    message: type[IdlStruct]
    latched: bool = False
    types: tuple[str, ...] = ()


TOPICS: Final = (
    RemoteTopic("operating_state", OperatingState, latched=True),
    RemoteTopic("tool_type", String, latched=True, types=("PSM",)),
    RemoteTopic("setpoint_cp", PoseStamped),
    RemoteTopic("measured_cv", TwistStamped),
    RemoteTopic("setpoint_js", JointStates),
    RemoteTopic("jaw/setpoint_js", JointStates, types=("PSM",)),
    RemoteTopic("gripper/measured_js", JointStates, types=("MTM",)),
    RemoteTopic(POSE, PoseStamped),
    RemoteTopic("goal_reached", Bool),
    RemoteTopic("warning", String),
    RemoteTopic("error", String),
)
"""In the order in which they are taken: the values that accompany a pose before it."""


class Delays:
    """How much later than usual a message is."""

    def __init__(self) -> None:
        self._least: list[int] = []
        self._since_ns = 0

    def late_ns(self, stamp_ns: int, local_ns: int) -> int:
        """The delay beyond the least one; 0 in simulated time. `local_ns`: the time of day."""
        delay = local_ns - stamp_ns
        if abs(delay) > SAME_CLOCK_NS:
            return 0
        if not self._least or local_ns - self._since_ns > WINDOW_NS:
            self._least, self._since_ns = [*self._least[-1:], delay], local_ns
        self._least[-1] = min(self._least[-1], delay)
        return delay - min(self._least)


class RemoteArm:
    """One arm; see above. `news` is whether a pose, or that it is not known, came since it was last set to False.

    `losses`: how often the arm was lost after it was there; `problem`: why it is not there, "": nothing came yet.
    """

    def __init__(self, row: RosArm, kind: str, refused: Callable[[str], None]) -> None:
        """`kind`: PSM, MTM or ECM; `refused` is called with the reason for each refused message."""
        self._row, self._refused = row, refused
        self._joint_names = ECM_JOINTS if kind == "ECM" else ()
        self.problem, self.losses = "", 0
        self.state, self.is_homed, self.is_busy, self.tool = "", False, False, ""
        """`state` empty: not known. Like the tool it outlives a loss, as many arms publish it on change only."""
        self._forget()

    def _forget(self) -> None:
        self.is_there = self.news = self.is_valid = False
        self.frame: str | None = None
        """Frame of its poses; None: no message yet."""
        self.pose = np.zeros(7)
        self.goal_reached: bool | None = None
        """The last message since it was set to None."""
        self._values: dict[str, tuple[int, Array]] = {}
        self._known: set[str] = set()
        self._publishers: dict[str, int] = {}
        self._stamps: dict[str, int] = {}
        self._delays = Delays()
        self._pose_ns = self._since_ns = self._poses = 0

    def value(self, topic: str) -> Array | None:
        """The newest value of a topic beside the pose; None: not known, or older than the pose."""
        when_ns, value = self._values.get(topic, (0, None))
        return value if value is not None and self._pose_ns - when_ns <= LAG_NS else None

    def knew(self, topic: str) -> bool:
        """Whether a value of this topic has arrived since the arm came."""
        return topic in self._known

    def take(self, topic: RemoteTopic, message: Any, publisher: int, now_ns: int, local_ns: int) -> None:
        """A message. `publisher`: the DDS handle of its sender; `now_ns`: monotonic, `local_ns`: the time of day."""
        name = topic.name
        try:
            if name == POSE:
                self._take_pose(topic, message, publisher, now_ns, local_ns)
            elif self._is_new(topic, message, publisher, local_ns):
                self._take_other(topic, message, now_ns)
        except ValueError as error:  # wrong joint names and poses are ValueErrors, too
            self._values.pop(name, None)
            if name == "operating_state":
                self.state = ""
            text = f"{self._row.namespace}/{name}: {str(error)[:MAX_TEXT]}"
            self._refused(text)
            if name == POSE:
                self.lose(text)

    def look(self, now_ns: int) -> None:
        """Once a period: whether it is silent."""
        if self._pose_ns and now_ns - self._pose_ns > LAG_NS:
            self.lose(f"{self._row.namespace}/{POSE} is silent: no new message for {LAG_NS * 1e-6:g} ms")

    def lose(self, why: str) -> None:
        """The arm is lost, or the half second in which it has to be good starts again."""
        self.losses += self.is_there
        self.problem = why if self._stamps else self.problem  # else nothing has come that could be lost
        self._forget()

    def _take_pose(self, topic: RemoteTopic, message: PoseStamped, publisher: int, now_ns: int, local_ns: int) -> None:
        self.look(now_ns)  # messages may have waited while we were stalled
        if not self._is_new(topic, message, publisher, local_ns):
            return
        self.is_valid = self._stamps[POSE] > 0
        if self.is_valid:
            frame = frame_of(message)
            if self.frame not in (None, frame):
                raise ValueError(f"its frame changed from {self.frame!r} to {frame!r}")
            self.pose, self.frame = normalised(np.array(pose_numbers(message.pose))), frame
        self._pose_ns, self._since_ns, self._poses = now_ns, self._since_ns or now_ns, self._poses + 1
        self.news = True
        if not self.is_there and now_ns - self._since_ns >= STEADY_NS:
            self.is_there = self._poses >= MIN_POSES
            mean_ms = STEADY_NS * 1e-6 / self._poses
            seldom = f"{self._row.namespace}/{POSE} comes every {mean_ms:.0f} ms; needed is every {LATE_S * 1e3:g} ms"
            self.problem = "" if self.is_there else seldom
            self._since_ns, self._poses = now_ns, 0

    def _is_new(self, topic: RemoteTopic, message: Any, publisher: int, local_ns: int) -> bool:
        """Whether its stamp is newer than that of the last message; ValueError for one that must not be used.

        A latched message may arrive after newer ones.
        """
        name = topic.name
        if self._publishers.setdefault(name, publisher) != publisher:
            raise ValueError("two programs publish it")
        header = getattr(message, "header", None)
        if header is None:
            return True
        stamp_ns, last_ns = header.stamp.sec * SECOND_NS + header.stamp.nanosec, self._stamps.get(name, 0)
        is_old = topic.latched and stamp_ns < last_ns
        if stamp_ns > 0 and (is_old or abs(stamp_ns - last_ns) < SAME_NS):
            return False
        if 0 < stamp_ns < last_ns:
            raise ValueError(f"out of order: sent {(last_ns - stamp_ns) * 1e-6:.3g} ms before the last message")
        self._stamps[name] = max(stamp_ns, 0)
        if stamp_ns > 0 and not topic.latched and (late_ns := self._delays.late_ns(stamp_ns, local_ns)) > LAG_NS:
            raise ValueError(f"{late_ns * 1e-6:.0f} ms late")
        return True

    def _take_other(self, topic: RemoteTopic, message: Any, now_ns: int) -> None:
        name = topic.name
        if isinstance(message, OperatingState):
            if message.state not in STATES:
                raise ValueError(f"{message.state[:20]!r} is no state; allowed are {', '.join(STATES)}")
            self.state, self.is_homed, self.is_busy = message.state, message.is_homed, message.is_busy
        elif isinstance(message, Bool):
            self.goal_reached = message.data
        elif name == "tool_type":
            self.tool = message.data
        elif self._stamps[name] <= 0:  # it marks invalid values
            self._values.pop(name, None)
        else:
            self._values[name] = now_ns, self._numbers(name, message)
            self._known.add(name)

    def _numbers(self, name: str, message: Any) -> Array:
        if isinstance(message, JointStates):
            return self._joints(name, message)
        frame, is_pose = frame_of(message), isinstance(message, PoseStamped)
        if self.frame not in (None, frame) and (is_pose or frame):
            raise ValueError(f"its frame is {frame!r}, that of {POSE} {self.frame!r}")
        if is_pose:
            return normalised(np.array(pose_numbers(message.pose)))
        return _finite(np.array(twist_numbers(message.twist)))

    def _joints(self, name: str, message: JointStates) -> Array:
        part = name.rpartition("/")[0]  # the jaw, the gripper, or none
        joints, names = (part,) if part else self._joint_names, message.name if self._row.check_names else ()
        numbers = message.position
        if joints:
            numbers = list(in_order(numbers, names, joints))
        elif names and (len(names) != len(numbers) or len(set(names)) != len(names)):
            raise ValueError(f"{len(numbers)} positions of joints {', '.join(names)}")
        if len(numbers) != (len(joints) or len(numbers)) or not 0 < len(numbers) <= MAX_JOINTS:
            raise ValueError(f"{len(numbers)} positions instead of {len(joints) or f'1 to {MAX_JOINTS}'}")
        return _finite(np.array(numbers))


def _finite(numbers: Array) -> Array:
    if not np.isfinite(numbers).all():
        raise ValueError("numbers must be finite")
    return numbers
