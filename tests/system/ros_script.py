"""Run by an interpreter that has rclpy: homes the robot and moves PSM1, as users' scripts do; prints what it saw."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from typing import Any

import rclpy
from geometry_msgs.msg import PoseStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState
from std_msgs.msg import Bool, Empty, String
from std_srvs.srv import Trigger

LATCHED = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
PATIENCE_S = 60.0


def main() -> None:
    """Subscribe, home, move, look."""
    rclpy.init()
    node = rclpy.create_node("script")
    got: dict[str, list[Any]] = {}

    def hear(topic: str, message: Any, qos: Any = 10) -> None:
        got[topic] = []
        node.create_subscription(message, topic, got[topic].append, qos)

    def wait(condition: Callable[[], object], what: str) -> None:
        end = time.monotonic() + PATIENCE_S
        while not condition():
            if time.monotonic() > end:
                raise TimeoutError(what)
            rclpy.spin_once(node, timeout_sec=0.05)

    def insist(publisher: Any, message: Any, condition: Callable[[], object], what: str) -> None:
        """Publish until it has its effect: ROS loses a message to a reader that does not know the publisher yet."""
        next_s = 0.0

        def is_done() -> object:
            nonlocal next_s
            if time.monotonic() > next_s and not condition():
                next_s = time.monotonic() + 1.0
                publisher.publish(message)
            return condition()

        wait(is_done, what)

    hear("/PSM1/measured_js", JointState)
    hear("/PSM1/measured_cp", PoseStamped)
    hear("/PSM1/goal_reached", Bool)
    hear("/PSM1/desired_state", String, LATCHED)
    home = node.create_publisher(Empty, "/system/home", 10)
    move = node.create_publisher(JointState, "/PSM1/move_jp", 10)
    joints, state = got["/PSM1/measured_js"], got["/PSM1/desired_state"]
    wait(lambda: joints and home.get_subscription_count() and move.get_subscription_count(), "the bridge")
    wait(lambda: state, "what was told before we came")
    first = joints[0].header.stamp
    insist(home, Empty(), lambda: joints[-1].header.stamp.sec and state[-1].data == "HOMED", "joints that are valid")
    here = list(joints[-1].position)
    insist(move, JointState(position=[here[0] + 0.2, *here[1:]]),
           lambda: abs(joints[-1].position[0] - here[0] - 0.2) < 1e-6, "the move")
    version = node.create_client(Trigger, "/PSM1/crtk_version")
    wait(version.service_is_ready, "the service")
    answers = [version.call_async(Trigger.Request()) for _ in range(3)]
    wait(lambda: all(answer.done() for answer in answers), "answers")
    published = [name for name, _ in node.get_publisher_names_and_types_by_node("ros_bridge", "/")]
    info = node.get_publishers_info_by_topic("/PSM1/measured_js")[0]
    print(json.dumps({
        "invalid_first": first.sec == 0 and first.nanosec == 0, "names": list(joints[-1].name),
        "versions": [answer.result().message for answer in answers],
        "services": dict(node.get_service_names_and_types_by_node("ros_bridge", "/")),
        "frame": got["/PSM1/measured_cp"][-1].header.frame_id, "nodes": node.get_node_names(), "published": published,
        "topics": len(node.get_topic_names_and_types()), "hash": str(info.topic_type_hash)}))


if __name__ == "__main__":
    main()
