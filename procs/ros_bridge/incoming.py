"""Commands accepted from ROS: the topics in the command table (shm/commands.py, column `ros`), and their messages.

`MESSAGES` defines how numbers and text are taken from each kind of message. The owner of the command checks the
numbers; here a message is only unpacked.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Final, NamedTuple

from cyclonedds.idl import IdlStruct

from trocar.procs.ros_messages.messages import (
    Bool,
    CartesianImpedance,
    CartesianState,
    Empty,
    Float64,
    Float64MultiArray,
    JointStates,
    Joy,
    PoseStamped,
    Quaternion,
    String,
    StringStamped,
    WrenchStamped,
)
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.command_row import CommandRow

Numbers = Sequence[float]
Take = Callable[[Any], Numbers]

XYZ: Final = ("x", "y", "z")
XYZW: Final = (*XYZ, "w")


def _within(part: str, names: Sequence[str]) -> tuple[str, ...]:
    """Paths of these in a part of a message."""
    return tuple(f"{part}.{name}" for name in names)


POSE: Final = (*_within("position", XYZ), *_within("orientation", XYZW))
WRENCH: Final = (*_within("force", XYZ), *_within("torque", XYZ))
TWIST: Final = (*_within("linear", XYZ), *_within("angular", XYZ))
pose_numbers: Final[Take] = attrgetter(*POSE)
"""x y z, quaternion x y z w."""
_STATE: Final = attrgetter(*_within("pose", POSE), *_within("twist", TWIST), *_within("wrench", WRENCH))
_FLAGS: Final = attrgetter("pose_is_valid.data", "twist_is_valid.data", "wrench_is_valid.data")


def _side(side: str) -> tuple[str, ...]:
    """Paths of the gains of one side, of places and orientations by turns."""
    return tuple(path for gain in ("p", "d", "bias", "deadband") for part in ("position", "orientation")
                 for path in _within(f"{part}_{side}.{gain}", XYZ))


def _nothing(message: Any) -> Numbers:
    return ()


def no_text(message: Any) -> str:
    """No text, or the name of the part in the topic."""
    return ""


def frame_of(message: Any) -> str:
    """The frame of its numbers."""
    return str(message.header.frame_id)


def _followed(message: JointStates) -> Numbers:
    """Positions, and velocities where there are any; velocities alone are no setpoint."""
    return [*message.position, *message.velocity] if message.position else []


def _state(message: CartesianState) -> Numbers:
    return (*_STATE(message), *map(float, _FLAGS(message)))


def _number(message: Any) -> Numbers:
    return (float(message.data),)


def _button(message: Joy) -> Numbers:
    return tuple(map(float, message.buttons[:1]))


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


STREAM: Final = 1

MESSAGES: Final = {
    "empty": Taken(Empty),
    "bool": Taken(Bool, _number),
    "number": Taken(Float64, _number),
    "numbers": Taken(Float64MultiArray, attrgetter("data")),
    "button": Taken(Joy, _button),
    "text": Taken(String, text=attrgetter("data")),
    "state": Taken(StringStamped, text=attrgetter("string")),
    "joint setpoint": Taken(JointStates, _followed),
    "joint positions": Taken(JointStates, attrgetter("position")),
    "joint velocities": Taken(JointStates, attrgetter("velocity")),
    "joint efforts": Taken(JointStates, attrgetter("effort")),
    "pose": Taken(PoseStamped, attrgetter(*_within("pose", POSE)), frame_of),
    "framed pose": Taken(PoseStamped, attrgetter(*_within("pose", POSE)), attrgetter("header.frame_id")),
    "quaternion": Taken(Quaternion, attrgetter(*XYZW)),
    "wrench": Taken(WrenchStamped, attrgetter(*_within("wrench", WRENCH)), frame_of),
    "cartesian state": Taken(CartesianState, _state, frame_of),
    "impedance": Taken(CartesianImpedance, attrgetter(
        *_within("force_position", XYZ), *_within("force_orientation", XYZW), *_within("torque_orientation", XYZW),
        *_side("positive"), *_side("negative")), frame_of),
}
"""Possible entries of the column `ros` of the command table."""

COMMAND_TOPICS: Final = tuple(
    CommandTopic(row.ros.kind or kind, topic, row, MESSAGES[row.ros.message])
    for kind, rows in COMMANDS.items() if kind != "third_party" for row in rows if row.ros is not None
    for topic in row.ros.topics or (row.name,))
