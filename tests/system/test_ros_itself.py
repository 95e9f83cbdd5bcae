"""The ROS bridge and ROS itself: rclpy with Fast DDS, from PyPI's wheels in an environment of its own (tools/peers)."""

from __future__ import annotations

import inspect
import itertools
import json
import os
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
import yaml
from cyclonedds.idl import IdlStruct

from tests.system.robot import ROOT, Robot, wait_for
from tests.system.test_ros_bridge import file_with
from trocar.procs.ros_messages import messages
from trocar.procs.ros_messages.dds import Participant
from trocar.procs.ros_messages.hashes import ros_name, type_hash

HOME = Path(os.environ.get("TROCAR_ROS", ROOT / ".venv-ros"))
PYTHON, HAS_ROS = HOME / "bin" / "python", any(HOME.glob("lib/python*/site-packages/rclpy"))
HERE = Path(__file__).parent
pytestmark = [pytest.mark.peers, pytest.mark.slow, pytest.mark.simulated("paced"),
              pytest.mark.skipif(not HAS_ROS, reason=f"no rclpy at {HOME}: tools/peers installs it")]
SHARE = HOME / "share"
ALL = {ros_name(kind): kind for _, kind in inspect.getmembers(messages, inspect.isclass)
       if issubclass(kind, IdlStruct) and kind is not IdlStruct}
KNOWN = {name: kind for name, kind in ALL.items() if (SHARE / f"{name}.json").exists()}
SENT = {name: kind for name, kind in KNOWN.items() if "/msg/" in name and not name.startswith("rmw")}


def environment(domain: int) -> dict[str, str]:
    libraries = f"{HOME / 'lib'}:{os.environ.get('LD_LIBRARY_PATH', '')}"
    return {**os.environ, "AMENT_PREFIX_PATH": str(HOME), "LD_LIBRARY_PATH": libraries, "ROS_DOMAIN_ID": str(domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}


@pytest.fixture
def fast_dds_leaves_nothing() -> Iterator[None]:
    """What Fast DDS leaves in shared memory when it is killed."""
    before = set(Path("/dev/shm").iterdir())
    yield
    for path in set(Path("/dev/shm").iterdir()) - before:
        if "fastrtps" in path.name or "fastdds" in path.name or "lttng" in path.name:
            path.unlink(missing_ok=True)


def filled(kind: Any, count: Iterator[int]) -> Any:
    """A message with other numbers in every place."""
    made = kind()
    for name, annotation in kind.__annotations__.items():
        what = annotation.__metadata__[0] if hasattr(annotation, "__metadata__") else annotation
        if name == "structure_needs_at_least_one_member":
            value: Any = 0
        elif hasattr(what, "subtype"):
            value = [_one(what.subtype, count) for _ in range(3)]
        else:
            value = _one(what, count)
        setattr(made, name, value)
    return made


def _one(what: Any, count: Iterator[int]) -> Any:
    inner = what.__metadata__[0] if hasattr(what, "__metadata__") else what
    if inner is bool:
        return True
    if inner is str:
        return f"text {next(count)} ä"
    if inspect.isclass(inner) and issubclass(inner, IdlStruct):
        return filled(inner, count)
    return float(next(count)) if str(inner).startswith("float") else next(count) % 100


def test_every_hash_is_that_of_the_installed_packages() -> None:
    assert len(KNOWN) >= 20
    for name, kind in KNOWN.items():
        rows = json.loads((SHARE / f"{name}.json").read_text())["type_hashes"]
        assert {row["type_name"]: row["hash_string"] for row in rows}[name] == type_hash(kind)


def test_every_message_goes_to_rclpy_and_back_unchanged(fast_dds_leaves_nothing: None) -> None:
    domain = 1 + os.getpid() % 230
    ours = Participant(domain, name="ours")
    with subprocess.Popen([PYTHON, HERE / "ros_echo.py", *SENT], env=environment(domain), stdout=subprocess.PIPE,
                          text=True) as echo:
        try:
            pairs = {}
            for name, kind in SENT.items():
                what = name.rpartition("/")[2]
                pairs[name] = ours.writer(f"there/{what}", kind), ours.reader(f"back/{what}", kind)
            ours.announce()
            assert echo.stdout is not None and echo.stdout.readline() == "ready\n"
            sent = {name: filled(kind, itertools.count(1)) for name, kind in SENT.items()}
            back: dict[str, Any] = {}

            def all_back() -> bool:
                for name, (writer, _) in pairs.items():
                    if name not in back:
                        writer.write(sent[name])
                ours.wait(50_000_000)
                for name, (_, reader) in pairs.items():
                    for message in reader.take():
                        back[name] = message
                return len(back) == len(pairs)

            wait_for(all_back, 60, "every message to come back")
            for name in SENT:
                assert back[name].serialize() == sent[name].serialize(), name
        finally:
            echo.kill()
            ours.close()


def test_a_script_with_rclpy_homes_and_moves_the_robot(
        robot: Robot, tmp_path: Path, fast_dds_leaves_nothing: None) -> None:
    made, domain = file_with(tmp_path)
    robot.up(made, "--path", str(ROOT / "configs"))
    done = subprocess.run([PYTHON, HERE / "ros_script.py"], env=environment(domain), capture_output=True, text=True,
                          timeout=200, check=False)
    assert done.returncode == 0, done.stderr
    seen = json.loads(done.stdout)
    assert seen["invalid_first"] and seen["frame"] == "PSM1_base" and "/PSM1/measured_js" in seen["published"]
    assert seen["names"] == ["yaw", "pitch", "insertion", "roll", "wrist_pitch", "wrist_yaw"]
    assert "ros_bridge" in seen["nodes"] and seen["topics"] > 100
    assert len(set(seen["versions"])) == 1 and seen["versions"][0]
    assert seen["services"]["/PSM1/inverse_kinematics"] == ["crtk_msgs/srv/QueryInverseKinematics"]


def test_the_launch_file_shows_the_description_and_joints_of_an_arm(
        robot: Robot, tmp_path: Path, fast_dds_leaves_nothing: None) -> None:
    made, domain = file_with(tmp_path)
    robot.up(made, "--path", str(ROOT / "configs"))
    done = subprocess.run([PYTHON, HERE / "ros_launch.py", ROOT / "configs/ros/arm.launch.py"], env=environment(domain),
                          capture_output=True, text=True, timeout=200, check=False)
    assert done.returncode == 0, done.stderr
    publisher, rviz = json.loads(done.stdout)
    urdf = ElementTree.fromstring(publisher["parameters"][0]["robot_description"])
    assert [joint.get("name") for joint in urdf.iter("joint")][:3] == ["yaw", "pitch", "insertion"]
    assert ["joint_states", "/PSM1/measured_js"] in publisher["remappings"]
    config = Path(rviz["arguments"][1])
    try:
        manager = yaml.safe_load(config.read_text())["Visualization Manager"]
        assert manager["Global Options"]["Fixed Frame"] == urdf.find("link").get("name")
        model = next(row for row in manager["Displays"] if row["Class"].endswith("RobotModel"))
        assert ["robot_description", model["Description Topic"]["Value"]] in publisher["remappings"]
    finally:
        config.unlink()
