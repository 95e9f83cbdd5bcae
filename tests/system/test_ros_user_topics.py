"""Topics of users' processes over ROS, as another participant receives them."""

from __future__ import annotations

from contextlib import closing
from pathlib import Path

import pytest
import yaml

from tests.system.robot import ROOT, Robot
from tests.system.test_ros_bridge import Client, file_with
from trocar.procs.ros_messages.messages import Float64MultiArray, JointStates, String, WrenchStamped

pytestmark = [pytest.mark.slow, pytest.mark.simulated("paced")]
CODE = """
import trocar


class Sensor(trocar.Process):
    count = 0

    def update(self):
        self.count += 1
        self.publish("push", wrench=[0, 0, self.count, 0.1, 0.2, 0.3], valid=self.count > 20)
        self.publish("joints", position=[0.1, 0.2], effort=[1, 2])
        self.publish("table", data=[[1, 2, 3], [4, 5, 6]])
        self.publish("phase", data="late" if self.count > 20 else "early")
"""
TOPICS = [
    {"name": "push", "ros": {"message": "geometry_msgs/WrenchStamped", "frame": "PSM1"},
     "fields": [{"name": "wrench", "type": "float[6]"}, {"name": "valid", "type": "bool"}]},
    {"name": "joints", "ros": {"message": "sensor_msgs/JointState", "joints": ["left", "right"]},
     "fields": [{"name": "position", "type": "float[2]"}, {"name": "effort", "type": "float32[2]"}]},
    {"name": "table", "ros": {"message": "std_msgs/Float64MultiArray"},
     "fields": [{"name": "data", "type": "int[2,3]"}]},
    {"name": "phase", "ros": {"message": "std_msgs/String"}, "fields": [{"name": "data", "type": "text[8]"}]},
    {"name": "silent", "fields": [{"name": "wrench", "type": "float[6]"}]},
]


def test_topics_of_a_users_process_become_the_messages_that_it_declares(robot: Robot, tmp_path: Path) -> None:
    made, domain = file_with(tmp_path, file=ROOT / "configs/systems/kinematic.yaml")
    (tmp_path / "sensor.py").write_text(CODE)
    system = yaml.safe_load(made.read_text())
    system["trocar"]["processes"] = [{"name": "sensor", "module": "sensor.py", "topics": TOPICS}]
    made.write_text(yaml.safe_dump(system))
    robot.up(made, "--path", str(ROOT / "configs"))
    with closing(Client(domain)) as client:
        for topic, message in (("push", WrenchStamped), ("joints", JointStates), ("table", Float64MultiArray),
                               ("phase", String), ("silent", WrenchStamped)):
            client.hear(f"sensor/{topic}", message)
        got = client.got
        client.wait(lambda: all(got[f"sensor/{name}"] for name in ("push", "joints", "table", "phase")), "all topics")
        client.wait(lambda: client.last("sensor/push").header.stamp.sec > 0, "a valid wrench")
        push, joints = client.last("sensor/push"), client.last("sensor/joints")
        assert push.header.frame_id == "PSM1" and push.wrench.force.z > 20 and push.wrench.torque.z == 0.3
        assert (joints.name, joints.position, joints.velocity) == (["left", "right"], [0.1, 0.2], [])
        assert joints.effort == [1.0, 2.0] and joints.header.stamp.sec > 0
        assert client.last("sensor/table").data == [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
        client.wait(lambda: client.last("sensor/phase").data == "late", "the last text, also for late subscribers")
        assert not got["sensor/silent"]
