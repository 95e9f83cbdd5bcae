"""Show an arm of a running system in RViz: `ros2 launch arm.launch.py arm:=PSM1`. docs/ros.md.

It needs robot_state_publisher and rviz2. The description is that of the bridge; joints come from its measured_js.
"""

from __future__ import annotations

import tempfile
import time
from typing import Any

import rclpy
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import String

PATIENCE_S = 20.0
RVIZ = """
Visualization Manager:
  Displays:
    - {{Class: rviz_default_plugins/Grid, Name: Grid, Enabled: true, Cell Size: 0.1}}
    - {{Class: rviz_default_plugins/TF, Name: TF, Enabled: false}}
    - Class: rviz_default_plugins/RobotModel
      Name: {arm}
      Enabled: true
      Description Source: Topic
      Description Topic: {{Value: {shown}, Durability Policy: Transient Local, Reliability Policy: Reliable}}
  Global Options: {{Fixed Frame: {arm}_base, Frame Rate: 30}}
  Tools: [{{Class: rviz_default_plugins/MoveCamera}}]
  Views: {{Current: {{Class: rviz_default_plugins/Orbit, Distance: 1.5}}}}
"""


def description(topic: str) -> str:
    """The URDF on a latched topic; RuntimeError if there is none."""
    rclpy.init()
    try:
        node, found = rclpy.create_node("trocar_launch"), list[str]()
        qos = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        node.create_subscription(String, topic, lambda message: found.append(message.data), qos)
        end = time.monotonic() + PATIENCE_S
        while not found and time.monotonic() < end:
            rclpy.spin_once(node, timeout_sec=0.1)
    finally:
        rclpy.shutdown()
    if not found:
        raise RuntimeError(f"no message on {topic} within {PATIENCE_S:g} s: is the system up, with the same "
                           "ROS_DOMAIN_ID, and is ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST set for a bridge on lo?")
    return found[0]


def shown(context: Any) -> list[Any]:
    """The nodes for one arm."""
    arm = LaunchConfiguration("arm").perform(context)
    name = "/".join(part for part in (LaunchConfiguration("namespace").perform(context), arm) if part)
    topic = f"/{name}/shown"
    with tempfile.NamedTemporaryFile("w", suffix=".rviz", prefix=f"{arm}_", delete=False) as config:
        config.write(RVIZ.format(arm=arm, shown=topic))
    return [
        Node(package="robot_state_publisher", executable="robot_state_publisher", namespace=name,
             parameters=[{"robot_description": description(f"/{name}/robot_description")}],
             remappings=[("joint_states", f"/{name}/measured_js"), ("robot_description", topic)]),
        Node(package="rviz2", executable="rviz2", name=f"rviz_{arm}", arguments=["-d", config.name]),
    ]


def generate_launch_description() -> LaunchDescription:
    """What `ros2 launch` calls."""
    return LaunchDescription([
        DeclareLaunchArgument("arm", default_value="PSM1", description="name of the arm"),
        DeclareLaunchArgument("namespace", default_value="", description="trocar: ros: namespace of the system"),
        OpaqueFunction(function=shown),
    ])
