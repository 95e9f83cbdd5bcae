"""The tables of the bridge: what dVRK's bridge has is there, and every row fits the commands and records of ours."""

from __future__ import annotations

from typing import Any

import numpy as np

from tests.cases import cases
from tests.command_rows import row_named
from tests.stock import ROOT
from trocar.procs.config.loading.load import load_system
from trocar.procs.ros_bridge.carrying_out import Addressee, topics_of
from trocar.procs.ros_bridge.incoming import COMMAND_TOPICS
from trocar.procs.ros_bridge.loop import addressees
from trocar.procs.ros_bridge.outgoing import EVENT_MESSAGES, FIELD_TOPICS
from trocar.procs.ros_bridge.services import SERVICES
from trocar.procs.ros_messages.hashes import ros_name
from trocar.procs.ros_messages.messages import (
    CartesianImpedance,
    CartesianImpedanceHalfPlaneGains,
    CartesianState,
    JointStates,
    Joy,
    MessageHeader,
    Pose,
    PoseStamped,
    Quaternion,
    StringStamped,
    Vector3,
)
from trocar.procs.ros_messages.view_messages import VIEW_MESSAGES
from trocar.procs.tables.arm_types import ARM_TYPES
from trocar.procs.tables.manifest import proc
from trocar.shm.commands import COMMANDS, may_power
from trocar.shm.system.directory import topic_of
from trocar.shm.topics import ARM_STATE

# What clients of dVRK 2.4 subscribe to (S), publish (P) or ask (V) of an arm.
HEARD = {
    "JointState": "measured_js setpoint_js gravity_compensation/setpoint_js jaw/measured_js jaw/setpoint_js "
                  "gripper/measured_js",
    "PoseStamped": "measured_cp setpoint_cp local/measured_cp local/setpoint_cp",
    "TwistStamped": "measured_cv local/measured_cv",
    "WrenchStamped": "body/measured_cf spatial/measured_cf",
    "Float64MultiArray": "body/jacobian spatial/jacobian",
}
TOLD = {
    "OperatingState": "operating_state", "Bool": "goal_reached gripper/closed orientation_locked",
    "String": "error warning status tool_type endoscope_type", "Joy": "arm_clutch",
    "Empty": "gripper/pinch tool_type_request",
}
CHANGED = {"String": "desired_state", "Float64": "trajectory_j/ratio trajectory_j/ratio_v trajectory_j/ratio_a"}
ASKED = {
    "StringStamped": "state_command", "Empty": "hold free unlock_orientation",
    "JointState": "servo_jp servo_jr move_jp move_jr servo_jf jaw/servo_jp jaw/move_jp jaw/servo_jf",
    "PoseStamped": "servo_cp move_cp set_base_frame", "CartesianState": "servo_cs", "CartesianImpedance": "servo_ci",
    "WrenchStamped": "body/servo_cf spatial/servo_cf",
    "Bool": "body/set_cf_orientation_absolute use_gravity_compensation emulate_adapter_present emulate_tool_present",
    "Float64": "trajectory_j/set_ratio trajectory_j/set_ratio_v trajectory_j/set_ratio_a",
    "Quaternion": "lock_orientation", "String": "set_tool_type set_endoscope_type",
}
OTHERS = {
    "teleop": "set_scale state_command lock_rotation lock_translation set_align_MTM following/mtm/body/servo_cf",
    "console": "teleop/enable teleop/select teleop/unselect teleop/set_scale emulate_operator_present emulate_clutch "
               "emulate_camera",
    "system": "power_off power_on home set_volume beep string_to_speech",
    "focus": "lock focus_in focus_out",
    "suj": "set_reference_arm state_command {part}/state_command {part}/servo_jp {part}/move_jp",
    "io": "{part}/power_on {part}/power_off", "pid": "{part}/enable {part}/use_setpoint_v",
}


def rows(expected: dict[str, str]) -> set[tuple[str, str]]:
    return {(name, kind) for kind, names in expected.items() for name in names.split()}


def short(message: Any) -> str:
    return ros_name(message).rpartition("/")[2]


def test_every_view_that_clients_of_an_arm_want_is_there_with_its_type() -> None:
    found = {(view.name, short(VIEW_MESSAGES[view.kind].message)) for view in ARM_STATE.views}
    assert rows(HEARD) <= found


def test_every_event_is_there_with_its_type() -> None:
    assert rows(TOLD) <= {(name, short(message)) for name, message in EVENT_MESSAGES.items()}
    assert rows(CHANGED) <= {(row.topic, short(row.message)) for row in FIELD_TOPICS if row.kind == "arm"}


def test_every_command_of_an_arm_is_there_with_its_type() -> None:
    assert rows(ASKED) <= {(row.topic, short(row.taken.message)) for row in COMMAND_TOPICS if row.kind == "arm"}


@cases("kind", OTHERS)
def test_consoles_teleoperations_and_the_others_take_what_they_take_from_the_original(kind: str) -> None:
    assert set(OTHERS[kind].split()) <= {row.topic for row in COMMAND_TOPICS if row.kind == kind}


def test_every_row_is_a_command_that_its_kind_has_and_an_empty_message_is_taken_apart() -> None:
    for row in COMMAND_TOPICS:
        message: Any = row.taken.message()
        assert isinstance(row.taken.text(message), str), row
        assert np.asarray(row.taken.numbers(message), dtype=np.float64).ndim == 1, row
        increments = row.row.name in ("servo_jr", "servo_cr")
        assert (row.depth == 1) is (bool(row.row.stream) and not increments and row.kind not in ("suj", "focus")), \
            f"of a stream only the newest counts, of increments and of all else each: {row}"


def test_every_told_field_is_one_of_its_kind() -> None:
    for row in FIELD_TOPICS:
        assert row.field in {field.name for field in topic_of(row.kind, "state").fields}, row


def test_every_event_of_arms_has_a_message() -> None:
    events = {name for kind in ("arm", "focus") for name in proc(kind).events}
    events |= {name for each in ARM_TYPES.values() for name in each.events}
    assert events <= set(EVENT_MESSAGES)


def test_every_service_is_a_command_of_arms() -> None:
    names = {row.name for row in COMMANDS["arm"]}
    assert {row.command for row in SERVICES.values() if row.command} <= names


def numbers_of(topic: str, message: Any) -> list[float]:
    row = next(row for row in COMMAND_TOPICS if row.topic == topic)
    return list(map(float, row.taken.numbers(message)))


def test_numbers_stand_where_commands_have_them() -> None:
    pose = Pose(orientation=Quaternion(4.0, 5.0, 6.0, 7.0))
    pose.position.x, pose.position.y, pose.position.z = 1.0, 2.0, 3.0
    assert numbers_of("servo_cp", PoseStamped(MessageHeader(), pose)) == [1, 2, 3, 4, 5, 6, 7]
    assert numbers_of("servo_jp", JointStates(position=[1.0, 2.0], velocity=[3.0, 4.0])) == [1, 2, 3, 4]
    assert numbers_of("servo_jp", JointStates(name=["a"], position=[1.0])) == [1]
    assert numbers_of("servo_jf", JointStates(effort=[8.0])) == [8]
    assert numbers_of("emulate_clutch", Joy(buttons=[2, 9])) == [2]
    state = CartesianState(pose=pose)
    state.pose_is_valid.data = True
    assert numbers_of("servo_cs", state) == [1, 2, 3, 4, 5, 6, 7, *[0] * 12, 1, 0, 0]


def test_an_impedance_is_taken_apart_as_scripts_give_it() -> None:
    count = iter(range(1, 1000))

    def vector() -> Vector3:
        return Vector3(*(float(next(count)) for _ in range(3)))

    def gains() -> CartesianImpedanceHalfPlaneGains:
        return CartesianImpedanceHalfPlaneGains(vector(), vector(), vector(), vector())

    message = CartesianImpedance(force_position=vector(), position_positive=gains(), position_negative=gains(),
                                 orientation_positive=gains(), orientation_negative=gains())
    found = numbers_of("servo_ci", message)
    assert found[:11] == [1, 2, 3, 0, 0, 0, 1, 0, 0, 0, 1]
    positive, negative = np.array(found[11:35]).reshape(4, 6), np.array(found[35:]).reshape(4, 6)
    assert positive[:, :3].ravel().tolist() == list(range(4, 16))
    assert negative[:, :3].ravel().tolist() == list(range(16, 28))
    assert positive[:, 3:].ravel().tolist() == list(range(28, 40))
    assert negative[:, 3:].ravel().tolist() == list(range(40, 52))


def test_setup_joints_have_topics_for_each_setup_arm() -> None:
    found = topics_of(Addressee("SUJ", "suj", parts=(("PSM1", "PSM1"), ("ECM", "ECM"))))
    assert ("PSM1/servo_jp", "PSM1") in {(topic, text) for _, topic, text in found}
    assert {("set_reference_arm", ""), ("PSM1/state_command", "")} < {(topic, text) for _, topic, text in found}


def test_only_psms_have_jaws_and_only_masters_lock_their_orientation() -> None:
    topics = {kind: {topic for _, topic, _ in topics_of(Addressee("X", "arm", kind))} for kind in ("PSM", "MTM", "ECM")}
    assert "jaw/move_jp" in topics["PSM"] - topics["MTM"] - topics["ECM"]
    assert "lock_orientation" in topics["MTM"] - topics["PSM"]


def test_arms_of_a_system_are_asked_what_their_type_is_asked() -> None:
    system = load_system(ROOT / "configs" / "systems" / "kinematic-full.yaml").system
    assert system is not None
    topics = {to.name: {topic for _, topic, _ in topics_of(to)} for to in addressees(system)}
    assert "jaw/move_jp" in topics["PSM2"] and "lock_orientation" in topics["MTML"]
    assert "set_endoscope_type" in topics["ECM"] and "jaw/move_jp" not in topics["ECM"]


@cases(("command", "numbers", "text", "expected"), [
    ("arm.state_command", [], "enable", True), ("arm.state_command", [], " home ", True),
    ("arm.state_command", [], "disable", False), ("arm.state_command", [], "pause", False),
    ("arm.state_command", [], "resume", True), ("io.power_on", [], "", True), ("system.home", [], "", True),
    ("system.power_off", [], "", False), ("console.teleop_enable", [1.0], "", True),
    ("console.teleop_enable", [0.0], "", False), ("arm.move_jp", [0.0], "", False),
    ("teleop.state_command", [], "align_MTM", True), ("console.emulate_camera", [1.0], "", True),
    ("io.tracking_check", [0.0], "", True), ("io.tracking_check", [1.0], "", False), ("suj.clutch", [1.0], "", True),
])
def test_what_powers_homes_or_begins_to_follow_is_known(
        command: str, numbers: list[float], text: str, expected: bool) -> None:
    kind, _, name = command.partition(".")
    assert may_power(row_named(name, kind), text, numbers) is expected


def test_a_state_command_is_its_text() -> None:
    row = next(row for row in COMMAND_TOPICS if row.topic == "state_command")
    assert row.taken.text(StringStamped(string="enable")) == "enable" and row.taken.message is StringStamped
