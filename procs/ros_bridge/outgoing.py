"""THE TABLE of what ROS hears: which message a view, an event or a field becomes, and how it is filled.

Views (PSM1/measured_js) go out every period while somebody reads them, with a stamp of 0 where they are not valid.
Events and fields that change go out at once; who comes late gets the last one.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from cyclonedds.idl import IdlStruct
from numpy.typing import NDArray

from procs.crtk.plain import plain
from procs.crtk.views import OpenTopic
from procs.ros_bridge.messages import (
    Bool,
    Empty,
    Float64,
    Float64MultiArray,
    JointStates,
    Joy,
    MultiArrayDimension,
    MultiArrayLayout,
    OperatingState,
    Point,
    Pose,
    PoseStamped,
    Quaternion,
    String,
    Twist,
    TwistStamped,
    Vector3,
    Wrench,
    WrenchStamped,
)

PRESSED: Final = {"released": 0, "pressed": 1, "clicked": 2}


def _joints(source: OpenTopic, message: JointStates) -> None:
    names = source.part("name").tobytes()
    if names != getattr(message, "named", None):
        message.name, message.named = source.labels(), names  # type: ignore[attr-defined]
    message.position, message.velocity, message.effort = (
        source.part(part).tolist() for part in ("position", "velocity", "effort"))


def pose_of(numbers: list[float]) -> Pose:
    """From x y z, quaternion x y z w."""
    return Pose(Point(*numbers[:3]), Quaternion(*numbers[3:]))


def _posed(source: OpenTopic, message: PoseStamped) -> None:
    message.pose = pose_of(source.part("pose").tolist())


def _moving(source: OpenTopic, message: TwistStamped) -> None:
    numbers = source.part("twist").tolist()
    message.twist = Twist(Vector3(*numbers[:3]), Vector3(*numbers[3:]))


def _pushing(source: OpenTopic, message: WrenchStamped) -> None:
    numbers = source.part("wrench").tolist()
    message.wrench = Wrench(Vector3(*numbers[:3]), Vector3(*numbers[3:]))


def _matrix(source: OpenTopic, message: Float64MultiArray) -> None:
    matrix = source.part("data")
    rows, columns = matrix.shape
    dimensions = [MultiArrayDimension("rows", rows, rows * columns), MultiArrayDimension("columns", columns, columns)]
    message.layout, message.data = MultiArrayLayout(dimensions, 0), matrix.ravel().tolist()


@dataclass(frozen=True, slots=True)
class ViewMessage:
    """What a kind of view becomes; `fill` puts the numbers of the record last read into a message."""

    message: type[IdlStruct]
    fill: Callable[[OpenTopic, Any], None]


VIEW_MESSAGES: Final = {
    "js": ViewMessage(JointStates, _joints),
    "cp": ViewMessage(PoseStamped, _posed),
    "cv": ViewMessage(TwistStamped, _moving),
    "cf": ViewMessage(WrenchStamped, _pushing),
    "jacobian": ViewMessage(Float64MultiArray, _matrix),
}

NOT_OF_ARMS: Final = frozenset(("setpoint_cv",))
"""Views that dVRK's bridge does not have."""

Row = dict[str, Any]


def _text(row: Row) -> String:
    return String(str(plain(row["text"])))


def _flag(row: Row) -> Bool:
    return Bool(bool(row["value"]))


def _none(row: Row) -> Empty:
    return Empty()


def _operating_state(row: Row) -> OperatingState:
    return OperatingState(state=str(plain(row["state"])), is_homed=bool(row["is_homed"]), is_busy=bool(row["is_busy"]))


def _pressed(row: Row) -> Joy:
    return Joy(buttons=[PRESSED.get(str(plain(row["text"])), int(bool(row["value"])))])


@dataclass(frozen=True, slots=True)
class EventMessage:
    """What an event becomes."""

    message: type[IdlStruct]
    of: Callable[[Row], Any]


EVENT_MESSAGES: Final = {
    "operating_state": EventMessage(OperatingState, _operating_state),
    "goal_reached": EventMessage(Bool, _flag),
    "arm_clutch": EventMessage(Joy, _pressed),
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
    """A field of the state of a kind (of arms or teleoperations of these types), told when it changes."""

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
    FieldTopic("system", "volume", "volume", Float64, _float),
)
