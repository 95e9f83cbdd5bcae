"""THE TABLE of which message a view becomes, and how it is filled: for the ROS bridge and for recordings."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

from trocar.procs.ros_messages.idl import IdlStruct
from trocar.procs.ros_messages.messages import (
    Float64MultiArray,
    JointStates,
    MultiArrayDimension,
    MultiArrayLayout,
    Point,
    Pose,
    PoseStamped,
    Quaternion,
    QuaternionStamped,
    Twist,
    TwistStamped,
    Vector3,
    Wrench,
    WrenchStamped,
)

ROWS: Final = 6
"""Of a Jacobian: linear, then angular."""
Blocks = list[list[float]]


def _joints(message: JointStates, blocks: Blocks) -> None:
    message.position, message.velocity, message.effort = blocks


def pose_of(numbers: list[float]) -> Pose:
    """From x y z, quaternion x y z w."""
    return Pose(Point(*numbers[:3]), Quaternion(*numbers[3:]))


def _posed(message: PoseStamped, blocks: Blocks) -> None:
    message.pose = pose_of(blocks[0])


def _moving(message: TwistStamped, blocks: Blocks) -> None:
    message.twist = Twist(Vector3(*blocks[0][:3]), Vector3(*blocks[0][3:]))


def _pushing(message: WrenchStamped, blocks: Blocks) -> None:
    message.wrench = Wrench(Vector3(*blocks[0][:3]), Vector3(*blocks[0][3:]))


def _turned(message: QuaternionStamped, blocks: Blocks) -> None:
    message.quaternion = Quaternion(*blocks[0])


def _matrix(message: Float64MultiArray, blocks: Blocks) -> None:
    rows, columns = ROWS, len(blocks[0]) // ROWS
    dimensions = [MultiArrayDimension("rows", rows, rows * columns), MultiArrayDimension("columns", columns, columns)]
    message.layout, message.data = MultiArrayLayout(dimensions, 0), blocks[0]


def _numbers(message: Float64MultiArray, blocks: Blocks) -> None:
    message.data = blocks[0]


@dataclass(frozen=True, slots=True)
class ViewMessage:
    """Message for a kind of view; `put` puts the numbers of these parts of the view into a message."""

    message: type[IdlStruct]
    parts: tuple[str, ...]
    put: Callable[[Any, Blocks], None]


VIEW_MESSAGES: Final = {
    "js": ViewMessage(JointStates, ("position", "velocity", "effort"), _joints),
    "cp": ViewMessage(PoseStamped, ("pose",), _posed),
    "cv": ViewMessage(TwistStamped, ("twist",), _moving),
    "cf": ViewMessage(WrenchStamped, ("wrench",), _pushing),
    "turn": ViewMessage(QuaternionStamped, ("orientation",), _turned),
    "jacobian": ViewMessage(Float64MultiArray, ("data",), _matrix),
    "numbers": ViewMessage(Float64MultiArray, ("data",), _numbers),
}
