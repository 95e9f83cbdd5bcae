"""THE TABLE of messages that carry commands: which numbers and text each kind of message has, in both directions.

The kinds are those of the column `ros` of the command table (shm/commands.py). The ROS bridge takes commands from such
messages; for an arm from ROS they are made.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, Final

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

Numbers = Sequence[float]
Take = Callable[[Any], Numbers]
Put = Callable[[Any, Numbers], None]

XYZ: Final = ("x", "y", "z")
XYZW: Final = (*XYZ, "w")


def _within(part: str, names: Sequence[str]) -> tuple[str, ...]:
    """Paths of these in a part of a message."""
    return tuple(f"{part}.{name}" for name in names)


POSE: Final = (*_within("position", XYZ), *_within("orientation", XYZW))
WRENCH: Final = (*_within("force", XYZ), *_within("torque", XYZ))
TWIST: Final = (*_within("linear", XYZ), *_within("angular", XYZ))
FLAGS: Final = ("pose_is_valid.data", "twist_is_valid.data", "wrench_is_valid.data")
pose_numbers: Final[Take] = attrgetter(*POSE)
"""x y z, quaternion x y z w."""
twist_numbers: Final[Take] = attrgetter(*TWIST)
"""Linear, then angular."""


def _side(side: str) -> tuple[str, ...]:
    """Paths of the gains of one side, of places and orientations by turns."""
    return tuple(path for gain in ("p", "d", "bias", "deadband") for part in ("position", "orientation")
                 for path in _within(f"{part}_{side}.{gain}", XYZ))


def no_text(message: Any) -> str:
    """No text, or the name of the part in the topic."""
    return ""


def frame_of(message: Any) -> str:
    """The frame of its numbers."""
    return str(message.header.frame_id)


def _nothing(message: Any) -> Numbers:
    return ()


def _no_numbers(message: Any, numbers: Numbers) -> None:
    pass


def _setter(path: str) -> Callable[[Any, Any], None]:
    """Sets the part at a path of a message."""
    *owner, name = path.split(".")
    owner_of: Callable[[Any], Any] = attrgetter(".".join(owner)) if owner else lambda message: message
    return lambda message, value: setattr(owner_of(message), name, value)


@dataclass(frozen=True, slots=True)
class CommandMessage:
    """A kind of message: how its numbers and its text are taken from it, and put into it.

    `text`: of a message; `text_at`: the path of that text, empty if the message has none.
    """

    message: type[IdlStruct]
    numbers: Take = _nothing
    put: Put = _no_numbers
    text: Callable[[Any], str] = no_text
    text_at: str = ""

    def made(self, numbers: Numbers, text: str) -> Any:
        """The message with these numbers and this text."""
        message = self.message()
        self.put(message, numbers)
        if self.text_at:
            _setter(self.text_at)(message, text)
        return message


def _at(message: type[IdlStruct], paths: Sequence[str], text_at: str = "", *, in_frame: bool = False) -> CommandMessage:
    """A message with one number at each path; `in_frame`: its text is the frame of the numbers."""
    take, setters = attrgetter(*paths), [_setter(path) for path in paths]

    def put(made: Any, numbers: Numbers) -> None:
        for set_it, number in zip(setters, numbers, strict=False):
            set_it(made, float(number))

    text_at = "header.frame_id" if in_frame else text_at
    text: Callable[[Any], str] = frame_of if in_frame else attrgetter(text_at) if text_at else no_text
    return CommandMessage(message, take, put, text, text_at)


def _number(message: Any) -> Numbers:
    return (float(message.data),)


def _button(message: Joy) -> Numbers:
    return tuple(map(float, message.buttons[:1]))


def _followed(message: JointStates) -> Numbers:
    """Positions, and velocities where there are any; velocities alone are no setpoint."""
    return [*message.position, *message.velocity] if message.position else []


def _state(message: CartesianState) -> Numbers:
    return tuple(map(float, _STATE.numbers(message)))


def _put_state(message: CartesianState, numbers: Numbers) -> None:
    count = len(numbers) - len(FLAGS)
    _STATE.put(message, numbers[:count])
    for flag, number in zip(FLAGS, numbers[count:], strict=True):
        _setter(flag)(message, bool(number))


def _put_as(cast: Callable[[float], Any], path: str = "data") -> Put:
    """The first number, as another type."""
    return lambda message, numbers: _setter(path)(message, cast(numbers[0]))


def _put_list(path: str) -> Put:
    return lambda message, numbers: _setter(path)(message, list(map(float, numbers)))


_STATE: Final = _at(CartesianState, (*_within("pose", POSE), *_within("twist", TWIST), *_within("wrench", WRENCH),
                                     *FLAGS), in_frame=True)
FRAMED: Final = _at(PoseStamped, _within("pose", POSE), "header.frame_id")

MESSAGES: Final = {
    "empty": CommandMessage(Empty),
    "bool": CommandMessage(Bool, _number, _put_as(bool)),
    "number": CommandMessage(Float64, _number, _put_as(float)),
    "numbers": CommandMessage(Float64MultiArray, attrgetter("data"), _put_list("data")),
    "button": CommandMessage(Joy, _button, _put_as(lambda number: [int(number)], "buttons")),
    "text": CommandMessage(String, text=attrgetter("data"), text_at="data"),
    "state": CommandMessage(StringStamped, text=attrgetter("string"), text_at="string"),
    "joint setpoint": CommandMessage(JointStates, _followed, _put_list("position")),
    "joint positions": CommandMessage(JointStates, attrgetter("position"), _put_list("position")),
    "joint velocities": CommandMessage(JointStates, attrgetter("velocity"), _put_list("velocity")),
    "joint efforts": CommandMessage(JointStates, attrgetter("effort"), _put_list("effort")),
    "pose": _at(PoseStamped, _within("pose", POSE), in_frame=True),
    "framed pose": FRAMED,
    "quaternion": _at(Quaternion, XYZW),
    "wrench": _at(WrenchStamped, _within("wrench", WRENCH), in_frame=True),
    "cartesian state": CommandMessage(CartesianState, _state, _put_state, frame_of, "header.frame_id"),
    "impedance": _at(CartesianImpedance, (
        *_within("force_position", XYZ), *_within("force_orientation", XYZW), *_within("torque_orientation", XYZW),
        *_side("positive"), *_side("negative")), in_frame=True),
}
"""Possible entries of the column `ros` of the command table."""
