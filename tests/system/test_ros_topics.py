"""The list of topics, types and settings that ROS sees is that of dVRK 2.4, typed in here anew."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import yaml
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication, BuiltinTopicDcpsSubscription
from cyclonedds.qos import Policy

from tests.system.robot import ROOT, Robot, wait_for
from tests.system.robot_in_host import HOSTED
from tests.system.test_ros_bridge import client_of, own_domain
from trocar.procs.ros_messages.messages import Bool, Empty, JointStates, Joy

pytestmark = [pytest.mark.slow, pytest.mark.simulated(HOSTED)]
PACKAGES = {
    "std_msgs": "Bool Empty Float64 Float64MultiArray String", "sensor_msgs": "JointState Joy",
    "geometry_msgs": "PoseStamped Quaternion QuaternionStamped TwistStamped WrenchStamped",
    "crtk_msgs": "CartesianImpedance CartesianState OperatingState StringStamped", "cisst_msgs": "IntervalStatistics",
    "tf2_msgs": "TFMessage",
}
DDS_NAMES = {name: f"{package}::msg::dds_::{name}_" for package, names in PACKAGES.items() for name in names.split()}
# P: published again and again, E: told when it happens and to late comers, S: subscribed to, V: a service
MESSAGES = [("E", "String", "error warning status")]
ARM = [
    ("P", "JointState", "measured_js setpoint_js gravity_compensation/setpoint_js"),
    ("P", "PoseStamped", "measured_cp setpoint_cp local/measured_cp local/setpoint_cp"),
    ("P", "TwistStamped", "measured_cv local/measured_cv"),
    ("P", "WrenchStamped", "body/measured_cf spatial/measured_cf"),
    ("P", "Float64MultiArray", "body/jacobian spatial/jacobian"),
    ("E", "OperatingState", "operating_state"), ("E", "String", "desired_state"), ("E", "Bool", "goal_reached"),
    ("E", "Float64", "trajectory_j/ratio trajectory_j/ratio_v trajectory_j/ratio_a"), *MESSAGES,
    ("V", "std_srvs Trigger", "crtk_version"), ("V", "crtk_msgs TriggerOperatingState", "operating_state"),
    ("V", "crtk_msgs QueryForwardKinematics", "forward_kinematics local/forward_kinematics"),
    ("V", "crtk_msgs QueryInverseKinematics", "inverse_kinematics"),
    ("V", "cisst_msgs ConvertFloat64Array", "actuator_to_joint_position"),
    ("S", "StringStamped", "state_command"), ("S", "Empty", "hold free"),
    ("S", "JointState", "servo_jp servo_jr move_jp move_jr servo_jf"),
    ("S", "PoseStamped", "servo_cp move_cp set_base_frame"), ("S", "CartesianState", "servo_cs"),
    ("S", "CartesianImpedance", "servo_ci"), ("S", "WrenchStamped", "body/servo_cf spatial/servo_cf"),
    ("S", "Bool", "body/set_cf_orientation_absolute use_gravity_compensation"),
    ("S", "Float64", "trajectory_j/set_ratio trajectory_j/set_ratio_v trajectory_j/set_ratio_a"),
]
PSM = [
    *ARM, ("P", "JointState", "jaw/measured_js jaw/setpoint_js"),
    ("S", "JointState", "jaw/servo_jp jaw/move_jp jaw/servo_jf"),
    ("S", "Bool", "emulate_adapter_present emulate_tool_present"), ("S", "String", "set_tool_type"),
    ("E", "String", "tool_type"), ("E", "Empty", "tool_type_request"), ("E", "Joy", "arm_clutch"),
]
ECM = [*ARM, ("S", "String", "set_endoscope_type"), ("E", "String", "endoscope_type"), ("E", "Joy", "arm_clutch")]
MTM = [
    *ARM, ("P", "JointState", "gripper/measured_js"), ("E", "Empty", "gripper/pinch"), ("E", "Bool", "gripper/closed"),
    ("S", "Quaternion", "lock_orientation"), ("S", "Empty", "unlock_orientation"), ("E", "Bool", "orientation_locked"),
]
SETUP_ARM = [
    ("P", "JointState", "measured_js"), ("P", "PoseStamped", "measured_cp local/measured_cp"),
    ("S", "JointState", "servo_jp move_jp"), ("E", "OperatingState", "operating_state"),
    ("S", "StringStamped", "state_command"), *MESSAGES,
    ("P", "JointState", "primary_voltage/measured_js secondary_voltage/measured_js"),
]
SYSTEM = [
    ("S", "Empty", "power_off power_on home"), ("S", "Float64", "set_volume"), ("E", "Float64", "volume"),
    ("S", "Float64MultiArray", "beep"), ("S", "String", "string_to_speech"),
]
CONSOLE = [
    ("S", "Bool", "teleop/enable"), ("E", "Bool", "teleop/enabled"), ("S", "String", "teleop/select teleop/unselect"),
    ("E", "String", "teleop/selected teleop/unselected"), ("S", "Float64", "teleop/set_scale"),
    ("E", "Float64", "teleop/scale"), ("E", "Joy", "operator_present clutch camera"),
    ("S", "Joy", "emulate_operator_present emulate_clutch emulate_camera"),
]
TELEOP = [
    ("E", "String", "desired_state current_state"), ("E", "Bool", "following"), ("E", "Float64", "scale"),
    ("S", "Float64", "set_scale"), ("S", "StringStamped", "state_command"), *MESSAGES,
]
TELEOP_PSM = [
    *TELEOP, ("E", "Joy", "rotation_locked translation_locked"), ("E", "Bool", "align_mtm"),
    ("S", "Bool", "lock_rotation lock_translation set_align_MTM"), ("P", "QuaternionStamped", "alignment_offset"),
    ("P", "PoseStamped", "MTM/measured_cp PSM/setpoint_cp"), ("P", "TwistStamped", "MTM/measured_cv"),
    ("S", "WrenchStamped", "following/mtm/body/servo_cf"),
]
TELEOP_ECM = [*TELEOP, ("P", "PoseStamped", "MTML/measured_cp MTMR/measured_cp ECM/measured_cp")]
PID = [("P", "JointState", "measured_js setpoint_js error_state/measured_js"), ("E", "Bool", "enabled setpoint_v_used"),
       ("S", "Bool", "enable use_setpoint_v")]
IO = [("P", "JointState", "measured_js pot/measured_js measured_current servo_current")]
STATS = [("P", "IntervalStatistics", "period_statistics")]
FULL = {
    "MTML": MTM, "MTMR": MTM, "PSM1": PSM, "PSM2": PSM, "PSM3": PSM, "ECM": ECM, "system": SYSTEM, "console": CONSOLE,
    **{f"SUJ/{name}": SETUP_ARM for name in ("PSM1", "PSM2", "PSM3", "ECM")},
    "SUJ": [("S", "String", "set_reference_arm")],
    "MTMR_PSM1": TELEOP_PSM, "MTML_PSM2": TELEOP_PSM, "MTML_PSM3": TELEOP_PSM, "MTML_MTMR_ECM": TELEOP_ECM,
    "stats/PSM1": STATS, "": [("P", "TFMessage", "tf")],
}
EMULATED = {
    "MTMR": MTM, "PSM1": PSM, "console": CONSOLE, "PID/PSM1": PID, "PID/MTMR": PID, "IO/IO1/PSM1": IO,
    "PSM1/IO": [("E", "Joy", "arm_clutch adapter tool")], "IO/IO1": [("E", "Joy", "clutch camera coag")],
}
Row = tuple[str, str, str]


def expected(table: dict[str, list[Row]]) -> set[tuple[str, str, str]]:
    """Direction, name and type as DDS has them."""
    rows = set()
    for prefix, each in table.items():
        for way, kind, names in each:
            for name in (f"{prefix}/{name}".strip("/") for name in names.split()):
                if way == "V":
                    package, what = kind.split()
                    rows |= {("S", f"rq/{name}Request", f"{package}::srv::dds_::{what}_Request_"),
                             ("P", f"rr/{name}Reply", f"{package}::srv::dds_::{what}_Response_")}
                else:
                    rows.add((way, f"rt/{name}", DDS_NAMES[kind]))
    return rows


def up(robot: Robot, folder: Path, file: str) -> int:
    """Start one of our systems with a bridge that shows all; returns the domain."""
    domain = own_domain()
    system = yaml.safe_load((ROOT / f"configs/systems/{file}.yaml").read_text())
    system.setdefault("trocar", {})["ros"] = {"domain": domain, "pid": "rw", "io": "rw"}
    made = folder / f"{file}.yaml"
    made.write_text(yaml.safe_dump(system))
    robot.up(made, "--path", str(ROOT / "configs"))
    return domain


@pytest.mark.parametrize(("file", "table"), [("kinematic-full", FULL), ("demo-teleop", EMULATED)])
def test_topics_types_and_settings_are_those_of_the_original(
        robot: Robot, tmp_path: Path, file: str, table: dict[str, list[Row]]) -> None:
    domain = up(robot, tmp_path, file)
    with client_of(robot, domain) as client:
        participant = client.participant
        own = {participant._graph.gid.data[:12]}
        found: dict[tuple[str, str, str], Any] = {}
        readers = [(way, BuiltinDataReader(participant._participant, topic))
                   for way, topic in (("P", BuiltinTopicDcpsPublication), ("S", BuiltinTopicDcpsSubscription))]

        def look() -> bool:
            for way, reader in readers:
                for each in reader.take(1000):
                    if each.sample_info.valid_data and each.key.bytes[:12] not in own:
                        latched = way == "P" and Policy.Durability.TransientLocal in each.qos
                        found["E" if latched else way, each.topic_name, each.type_name] = each.qos
            return expected(table) <= found.keys()

        try:
            wait_for(look, 60, "every topic")
        finally:
            missing = expected(table) - found.keys()
            assert not missing, "\n".join(map(str, sorted(missing)))
        for (way, name, _), qos in found.items():
            assert Policy.Reliability.Reliable(100_000_000) in qos, name
            if way != "E":
                assert Policy.Durability.Volatile in qos or name == "ros_discovery_info", name
            assert Policy.Ownership.Shared in qos and not [p for p in qos if type(p).__name__ == "Partition"], name


def test_pedals_and_joint_controllers_of_boards_are_heard_and_asked(robot: Robot, tmp_path: Path) -> None:
    with client_of(robot, up(robot, tmp_path, "demo-teleop")) as client:
        for topic, message in (("IO/IO1/coag", Joy), ("PSM1/IO/arm_clutch", Joy), ("PID/PSM1/measured_js", JointStates),
                               ("PID/PSM1/error_state/measured_js", JointStates), ("PID/PSM1/enabled", Bool),
                               ("PID/PSM1/setpoint_v_used", Bool), ("IO/IO1/PSM1/pot/measured_js", JointStates)):
            client.hear(topic, message)
        client.wait(lambda: all(client.got[topic] for topic in client.got if topic.endswith("_js")), "joints")
        assert len(client.last("PID/PSM1/measured_js").position) == 7
        robot.trocar("send", "boards", "press", "coag", "1")
        client.wait(lambda: client.got["IO/IO1/coag"] and client.last("IO/IO1/coag").buttons == [1], "the pedal")
        robot.trocar("send", "boards", "press", "PSM1_arm_clutch", "1")
        client.wait(lambda: client.got["PSM1/IO/arm_clutch"], "the button on the arm")
        client.tell("PID/PSM1/use_setpoint_v", Bool(True))
        client.wait(lambda: client.got["PID/PSM1/setpoint_v_used"] and client.last("PID/PSM1/setpoint_v_used").data,
                    "the velocity feed to be used")
        client.tell("IO/IO1/PSM1/power_on", Empty())
        client.wait(lambda: any(json.loads(robot.trocar("echo", "IO1/state", "--json", "--once"))["power_requested"]),
                    "power")
