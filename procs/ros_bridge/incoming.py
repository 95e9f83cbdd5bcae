"""What ROS may ask: the topics that the command table (shm/commands.py, column `ros`) names, and their messages.

`MESSAGES` says how numbers and text are taken from each kind of message. The owner of the command checks the numbers;
here a message is only taken apart.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from cyclonedds.idl import IdlStruct

from trocar.procs.ros_messages.messages import (
    Bool,
    CartesianImpedance,
    CartesianImpedanceHalfPlaneGains,
    CartesianState,
    Empty,
    Float64,
    Float64MultiArray,
    JointStates,
    Joy,
    Pose,
    PoseStamped,
    Quaternion,
    String,
    StringStamped,
    Vector3,
    Wrench,
    WrenchStamped,
)
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.command_row import CommandRow

Numbers = Sequence[float]
Take = Callable[[Any], Numbers]


def _nothing(message: Any) -> Numbers:
    return ()


def no_text(message: Any) -> str:
    """Nothing: or the name of the part in the topic."""
    return ""


def _vector(v: Vector3) -> tuple[float, ...]:
    return v.x, v.y, v.z


def _turn(q: Quaternion) -> tuple[float, ...]:
    return q.x, q.y, q.z, q.w


def pose_numbers(pose: Pose) -> tuple[float, ...]:
    """x y z, quaternion x y z w."""
    p = pose.position
    return (p.x, p.y, p.z, *_turn(pose.orientation))


def _wrench(wrench: Wrench) -> tuple[float, ...]:
    return *_vector(wrench.force), *_vector(wrench.torque)


def _posed(message: PoseStamped) -> Numbers:
    return pose_numbers(message.pose)


def _positions(message: JointStates) -> Numbers:
    return message.position


def _followed(message: JointStates) -> Numbers:
    """Positions, and velocities where there are any."""
    return [*message.position, *message.velocity]


def _state(message: CartesianState) -> Numbers:
    twist = message.twist
    flags = message.pose_is_valid.data, message.twist_is_valid.data, message.wrench_is_valid.data
    return (*pose_numbers(message.pose), *_vector(twist.linear), *_vector(twist.angular), *_wrench(message.wrench),
            *map(float, flags))


def _side(place: CartesianImpedanceHalfPlaneGains, orientation: CartesianImpedanceHalfPlaneGains) -> tuple[float, ...]:
    rows = ((place.p, orientation.p), (place.d, orientation.d), (place.bias, orientation.bias),
            (place.deadband, orientation.deadband))
    return tuple(number for pair in rows for part in pair for number in _vector(part))


def _impedance(message: CartesianImpedance) -> Numbers:
    return (*_vector(message.force_position), *_turn(message.force_orientation), *_turn(message.torque_orientation),
            *_side(message.position_positive, message.orientation_positive),
            *_side(message.position_negative, message.orientation_negative))


class Taken(NamedTuple):
    """A message, and how its numbers and its text are taken from it."""

    message: type[IdlStruct]
    numbers: Take = _nothing
    text: Callable[[Any], str] = no_text


@dataclass(frozen=True, slots=True)
class CommandTopic:
    """One topic of an instance of this kind, and of arms of these types (none: of all)."""

    kind: str
    topic: str
    row: CommandRow
    taken: Taken

    @property
    def depth(self) -> int:
        """Messages that are kept until they are carried out; where only the newest counts, that one."""
        return STREAM if self.row.ros is not None and self.row.ros.newest else 10


def _number(message: Any) -> Numbers:
    return (float(message.data),)


def _button(message: Joy) -> Numbers:
    return tuple(map(float, message.buttons[:1]))


def _data(message: String) -> str:
    return message.data


def _stamped(message: StringStamped) -> str:
    return message.string


def _frame(message: PoseStamped) -> str:
    return message.header.frame_id


def _efforts(message: JointStates) -> Numbers:
    return message.effort


def _velocities(message: JointStates) -> Numbers:
    return message.velocity


def _wrenched(message: WrenchStamped) -> Numbers:
    return _wrench(message.wrench)


STREAM: Final = 1

MESSAGES: Final = {
    "empty": Taken(Empty),
    "bool": Taken(Bool, _number),
    "number": Taken(Float64, _number),
    "numbers": Taken(Float64MultiArray, lambda message: message.data),
    "button": Taken(Joy, _button),
    "text": Taken(String, text=_data),
    "state": Taken(StringStamped, text=_stamped),
    "joint setpoint": Taken(JointStates, _followed),
    "joint positions": Taken(JointStates, _positions),
    "joint velocities": Taken(JointStates, _velocities),
    "joint efforts": Taken(JointStates, _efforts),
    "pose": Taken(PoseStamped, _posed),
    "framed pose": Taken(PoseStamped, _posed, _frame),
    "quaternion": Taken(Quaternion, _turn),
    "wrench": Taken(WrenchStamped, _wrenched),
    "cartesian state": Taken(CartesianState, _state),
    "impedance": Taken(CartesianImpedance, _impedance),
}
"""What the column `ros` of the command table can name."""

COMMAND_TOPICS: Final = tuple(
    CommandTopic(row.ros.kind or kind, topic, row, MESSAGES[row.ros.message])
    for kind, rows in COMMANDS.items() if kind != "third_party" for row in rows if row.ros is not None
    for topic in row.ros.topics or (row.name,))
