"""THE TABLE of what ROS hears: which message an event or a field becomes, and how it is filled.

Views (PSM1/measured_js, procs/ros_messages/view_messages.py) go out every period while somebody reads them, with a
stamp of 0 where they are not valid.
Events and fields that change go out at once; who comes late gets the last one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from cyclonedds.idl import IdlStruct
from numpy.typing import NDArray

from trocar.procs.crtk.plain import plain
from trocar.procs.ros_messages.messages import Bool, Empty, Float64, Joy, OperatingState, String

PRESSED: Final = {"released": 0, "pressed": 1, "clicked": 2}
Row = dict[str, Any]


def _text(row: Row) -> String:
    return String(str(plain(row["text"])))


def _flag(row: Row) -> Bool:
    return Bool(bool(row["value"]))


def _none(row: Row) -> Empty:
    return Empty()


def _operating_state(row: Row) -> OperatingState:
    return OperatingState(state=str(plain(row["state"])), is_homed=bool(row["is_homed"]), is_busy=bool(row["is_busy"]))


def pressed(row: Row) -> Joy:
    """A button's event."""
    return Joy(buttons=[PRESSED.get(str(plain(row["text"])), int(bool(row["value"])))])


@dataclass(frozen=True, slots=True)
class EventMessage:
    """What an event becomes."""

    message: type[IdlStruct]
    of: Callable[[Row], Any]


EVENT_MESSAGES: Final = {
    "operating_state": EventMessage(OperatingState, _operating_state),
    "goal_reached": EventMessage(Bool, _flag),
    "arm_clutch": EventMessage(Joy, pressed),
    "tool_type": EventMessage(String, _text),
    "tool_type_request": EventMessage(Empty, _none),
    "endoscope_type": EventMessage(String, _text),
    "gripper/pinch": EventMessage(Empty, _none),
    "gripper/closed": EventMessage(Bool, _flag),
    "orientation_locked": EventMessage(Bool, _flag),
    "locked": EventMessage(Bool, _flag),
    "focusing_in": EventMessage(Bool, _flag),
    "focusing_out": EventMessage(Bool, _flag),
    "status": EventMessage(String, _text),
    "warning": EventMessage(String, _text),
    "error": EventMessage(String, _text),
}

Cell = NDArray[Any]


def _string(cell: Cell) -> String:
    return String(str(plain(cell.item())))


def _bool(cell: Cell) -> Bool:
    return Bool(bool(cell))


def _float(cell: Cell) -> Float64:
    return Float64(float(cell))


def _joy(cell: Cell) -> Joy:
    return Joy(buttons=[int(cell)])


@dataclass(frozen=True, slots=True)
class FieldTopic:
    """A field of the state of a kind (of teleoperations of these types), told when it changes.

    `topic` is behind the name of the instance; one of io has the name of an arm in it, and is the field of its robot.
    """

    kind: str
    topic: str
    field: str
    message: type[IdlStruct]
    of: Callable[[Cell], Any]
    types: tuple[str, ...] = ()


FIELD_TOPICS: Final = (
    FieldTopic("arm", "desired_state", "desired_state", String, _string),
    FieldTopic("arm", "trajectory_j/ratio", "trajectory_ratio", Float64, _float),
    FieldTopic("arm", "trajectory_j/ratio_v", "trajectory_ratio_v", Float64, _float),
    FieldTopic("arm", "trajectory_j/ratio_a", "trajectory_ratio_a", Float64, _float),
    FieldTopic("suj", "desired_state", "desired_state", String, _string),
    FieldTopic("teleop", "desired_state", "desired_state", String, _string),
    FieldTopic("teleop", "current_state", "state", String, _string),
    FieldTopic("teleop", "following", "following", Bool, _bool),
    FieldTopic("teleop", "scale", "scale", Float64, _float),
    FieldTopic("teleop", "rotation_locked", "rotation_locked", Joy, _joy, ("PSM",)),
    FieldTopic("teleop", "translation_locked", "translation_locked", Joy, _joy, ("PSM",)),
    FieldTopic("teleop", "align_mtm", "align_mtm", Bool, _bool, ("PSM",)),
    FieldTopic("console", "teleop/enabled", "teleop_enabled", Bool, _bool),
    FieldTopic("console", "teleop/scale", "scale", Float64, _float),
    FieldTopic("console", "operator_present", "operator_present", Joy, _joy),
    FieldTopic("console", "clutch", "clutch", Joy, _joy),
    FieldTopic("console", "camera", "camera", Joy, _joy),
    FieldTopic("io", "PID/{arm}/enabled", "pid_enabled", Bool, _bool),
    FieldTopic("io", "PID/{arm}/setpoint_v_used", "use_setpoint_velocity", Bool, _bool),
    FieldTopic("system", "volume", "volume", Float64, _float),
)
