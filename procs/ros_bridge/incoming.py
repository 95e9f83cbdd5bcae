"""THE TABLE of what ROS may ask: topics, their messages, and the command that each becomes.

A row is all that a new topic needs. `topic` is behind the name of the instance, `{part}` stands for each setup arm or
robot; `numbers` and `text` take from a message what the command table (shm/commands.py) says. What the numbers may be
is for whoever carries the command out; here a message is only taken apart.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

from cyclonedds.idl import IdlStruct

from procs.ros.messages import (
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


@dataclass(frozen=True, slots=True)
class CommandTopic:
    """One topic of an instance of this kind, and of arms of these types (none: of all)."""

    kind: str
    topic: str
    message: type[IdlStruct]
    numbers: Take = _nothing
    text: Callable[[Any], str] = no_text
    command: str = ""
    """Empty: it is called as the topic."""
    types: tuple[str, ...] = ()
    depth: int = 10
    """Messages that are kept until they are carried out; of a stream the newest."""

    @property
    def asks(self) -> str:
        """The command."""
        return self.command or self.topic


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
ARM, PSM, MTM, ECM = "arm", ("PSM",), ("MTM",), ("ECM",)

COMMAND_TOPICS: Final = (
    CommandTopic(ARM, "state_command", StringStamped, text=_stamped),
    CommandTopic(ARM, "hold", Empty),
    CommandTopic(ARM, "free", Empty),
    CommandTopic(ARM, "servo_jp", JointStates, _followed, depth=STREAM),
    CommandTopic(ARM, "servo_jr", JointStates, _positions),
    CommandTopic(ARM, "servo_jv", JointStates, _velocities, depth=STREAM),
    CommandTopic(ARM, "servo_jf", JointStates, _efforts, depth=STREAM),
    CommandTopic(ARM, "servo_cp", PoseStamped, _posed, depth=STREAM),
    CommandTopic(ARM, "servo_cr", PoseStamped, _posed),
    CommandTopic(ARM, "servo_cs", CartesianState, _state, depth=STREAM),
    CommandTopic(ARM, "servo_ci", CartesianImpedance, _impedance, depth=STREAM),
    CommandTopic(ARM, "body/servo_cf", WrenchStamped, _wrenched, depth=STREAM),
    CommandTopic(ARM, "spatial/servo_cf", WrenchStamped, _wrenched, depth=STREAM),
    CommandTopic(ARM, "body/set_cf_orientation_absolute", Bool, _number),
    CommandTopic(ARM, "move_jp", JointStates, _positions),
    CommandTopic(ARM, "move_jr", JointStates, _positions),
    CommandTopic(ARM, "move_cp", PoseStamped, _posed),
    CommandTopic(ARM, "move_cr", PoseStamped, _posed),
    CommandTopic(ARM, "set_base_frame", PoseStamped, _posed, _frame),
    CommandTopic(ARM, "use_gravity_compensation", Bool, _number),
    CommandTopic(ARM, "trajectory_j/set_ratio", Float64, _number),
    CommandTopic(ARM, "trajectory_j/set_ratio_v", Float64, _number),
    CommandTopic(ARM, "trajectory_j/set_ratio_a", Float64, _number),
    CommandTopic(ARM, "jaw/servo_jp", JointStates, _positions, types=PSM, depth=STREAM),
    CommandTopic(ARM, "jaw/servo_jf", JointStates, _efforts, types=PSM, depth=STREAM),
    CommandTopic(ARM, "jaw/move_jp", JointStates, _positions, types=PSM),
    CommandTopic(ARM, "emulate_adapter_present", Bool, _number, types=PSM),
    CommandTopic(ARM, "emulate_tool_present", Bool, _number, types=PSM),
    CommandTopic(ARM, "set_tool_type", String, text=_data, types=PSM),
    CommandTopic(ARM, "set_endoscope_type", String, text=_data, types=ECM),
    CommandTopic(ARM, "lock_orientation", Quaternion, _turn, types=MTM),
    CommandTopic(ARM, "unlock_orientation", Empty, types=MTM),
    CommandTopic("suj", "state_command", StringStamped, text=_stamped),
    CommandTopic("suj", "set_reference_arm", String, text=_data),
    CommandTopic("suj", "{part}/state_command", StringStamped, text=_stamped, command="state_command"),
    CommandTopic("suj", "{part}/servo_jp", JointStates, _positions, command="servo_jp"),
    CommandTopic("suj", "{part}/move_jp", JointStates, _positions, command="move_jp"),
    CommandTopic("teleop", "state_command", StringStamped, text=_stamped),
    CommandTopic("teleop", "set_scale", Float64, _number),
    CommandTopic("teleop", "lock_rotation", Bool, _number, types=PSM),
    CommandTopic("teleop", "lock_translation", Bool, _number, types=PSM),
    CommandTopic("teleop", "set_align_MTM", Bool, _number, types=PSM),
    CommandTopic("teleop", "following/mtm/body/servo_cf", WrenchStamped, _wrenched, types=PSM, depth=STREAM),
    CommandTopic("console", "teleop/enable", Bool, _number, command="teleop_enable"),
    CommandTopic("console", "teleop/select", String, text=_data, command="select_teleop"),
    CommandTopic("console", "teleop/unselect", String, text=_data, command="unselect_teleop"),
    CommandTopic("console", "teleop/set_scale", Float64, _number, command="set_scale"),
    CommandTopic("console", "emulate_operator_present", Joy, _button),
    CommandTopic("console", "emulate_clutch", Joy, _button),
    CommandTopic("console", "emulate_camera", Joy, _button),
    CommandTopic("focus", "lock", Bool, _number),
    CommandTopic("focus", "focus_in", Bool, _number),
    CommandTopic("focus", "focus_out", Bool, _number),
    CommandTopic("io", "{part}/power_on", Empty, command="power_on"),
    CommandTopic("io", "{part}/power_off", Empty, command="power_off"),
    CommandTopic("io", "{part}/brake_release", Empty, command="brake_release"),
    CommandTopic("io", "{part}/brake_engage", Empty, command="brake_engage"),
    CommandTopic("io", "{part}/tracking_check", Bool, _number, command="tracking_check"),
    CommandTopic("io", "{part}/pot_check", Bool, _number, command="pot_check"),
    CommandTopic("pid", "{part}/enable", Bool, _number, command="pid_enable"),
    CommandTopic("pid", "{part}/use_setpoint_v", Bool, _number, command="use_setpoint_v"),
    CommandTopic("system", "power_off", Empty),
    CommandTopic("system", "power_on", Empty),
    CommandTopic("system", "home", Empty),
    CommandTopic("system", "set_volume", Float64, _number),
    CommandTopic("system", "beep", Float64MultiArray, lambda message: message.data),
    CommandTopic("system", "string_to_speech", String, text=_data),
)
