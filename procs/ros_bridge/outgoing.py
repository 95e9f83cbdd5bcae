"""THE TABLE of published ROS data: the message for each event or field, and its contents.

Views (PSM1/measured_js, procs/ros_messages/view_messages.py) are published every period while they have a reader, with
a stamp of 0 if invalid. Events and changed fields are published at once; late subscribers get the last one.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeVar

from cyclonedds.idl import IdlStruct
from numpy.typing import NDArray

from trocar.procs.crtk.plain import plain
from trocar.procs.ros_messages.messages import Bool, Empty, Float64, Joy, OperatingState, String, time_of

PRESSED: Final = {"released": 0, "pressed": 1, "clicked": 2}
Row = dict[str, Any]
Cell = NDArray[Any]
M = TypeVar("M")


def stamped(message: M, ns: int) -> M:
    """The message with this stamp, where its kind has one."""
    header = getattr(message, "header", None)
    if header is not None:
        header.stamp = time_of(ns)
    return message


def _operating_state(row: Row) -> OperatingState:
    return OperatingState(state=str(plain(row["state"])), is_homed=bool(row["is_homed"]), is_busy=bool(row["is_busy"]))


def _pressed(row: Row) -> Joy:
    """A button's event."""
    return Joy(buttons=[PRESSED.get(str(plain(row["text"])), int(bool(row["value"])))])


OF_EVENT: Final[Mapping[type[IdlStruct], Callable[[Row], Any]]] = {
    OperatingState: _operating_state,
    Joy: _pressed,
    String: lambda row: String(str(plain(row["text"]))),
    Bool: lambda row: Bool(bool(row["value"])),
    Empty: lambda row: Empty(),
}
"""How a message is filled from an event,"""
OF_FIELD: Final[Mapping[type[IdlStruct], Callable[[Cell], Any]]] = {
    String: lambda cell: String(str(plain(cell.item()))),
    Bool: lambda cell: Bool(bool(cell)),
    Float64: lambda cell: Float64(float(cell)),
    Joy: lambda cell: Joy(buttons=[int(cell)]),
}
"""and from a field."""

EVENT_MESSAGES: Final[Mapping[str, type[IdlStruct]]] = {
    "operating_state": OperatingState,
    "goal_reached": Bool,
    "arm_clutch": Joy,
    "tool_type": String,
    "tool_type_request": Empty,
    "endoscope_type": String,
    "gripper/pinch": Empty,
    "gripper/closed": Bool,
    "orientation_locked": Bool,
    "locked": Bool,
    "focusing_in": Bool,
    "focusing_out": Bool,
    "status": String,
    "warning": String,
    "error": String,
}


@dataclass(frozen=True, slots=True)
class FieldTopic:
    """A field of the state of a kind (of teleoperations of these types), published when it changes.

    `topic` follows the name of the instance; one of io contains the name of an arm, and is the field of its robot.
    """

    kind: str
    topic: str
    field: str
    message: type[IdlStruct]
    types: tuple[str, ...] = ()


FIELD_TOPICS: Final = (
    FieldTopic("arm", "desired_state", "desired_state", String),
    FieldTopic("arm", "trajectory_j/ratio", "trajectory_ratio", Float64),
    FieldTopic("arm", "trajectory_j/ratio_v", "trajectory_ratio_v", Float64),
    FieldTopic("arm", "trajectory_j/ratio_a", "trajectory_ratio_a", Float64),
    FieldTopic("suj", "desired_state", "desired_state", String),
    FieldTopic("teleop", "desired_state", "desired_state", String),
    FieldTopic("teleop", "current_state", "state", String),
    FieldTopic("teleop", "following", "following", Bool),
    FieldTopic("teleop", "scale", "scale", Float64),
    FieldTopic("teleop", "rotation_locked", "rotation_locked", Joy, ("PSM",)),
    FieldTopic("teleop", "translation_locked", "translation_locked", Joy, ("PSM",)),
    FieldTopic("teleop", "align_mtm", "align_mtm", Bool, ("PSM",)),
    FieldTopic("console", "teleop/enabled", "teleop_enabled", Bool),
    FieldTopic("console", "teleop/scale", "scale", Float64),
    FieldTopic("console", "operator_present", "operator_present", Joy),
    FieldTopic("console", "clutch", "clutch", Joy),
    FieldTopic("console", "camera", "camera", Joy),
    FieldTopic("io", "PID/{arm}/enabled", "pid_enabled", Bool),
    FieldTopic("io", "PID/{arm}/setpoint_v_used", "use_setpoint_velocity", Bool),
    FieldTopic("system", "volume", "volume", Float64),
)
