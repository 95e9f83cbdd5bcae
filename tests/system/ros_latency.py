"""Run by an interpreter that has rclpy, by hand: age on arrival and gaps of 30 topics of the full robot, as JSON.

    trocar up configs/systems/kinematic-full.yaml --set clock=wall --set ros.domain=42 --detach && trocar home
    export AMENT_PREFIX_PATH=$PWD/.venv-ros LD_LIBRARY_PATH=$PWD/.venv-ros/lib RMW_IMPLEMENTATION=rmw_fastrtps_cpp
    export ROS_DOMAIN_ID=42 ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST
    .venv-ros/bin/python tests/system/ros_latency.py 20 1

Arguments: seconds, and the depth of each subscription. With 1, a client that is too slow gets the newest messages, so
ages are those of the way; with 100, it gets all, late. Ages (ms) are from the stamp of the record, in the arm, to the
callback; `gaps` are intervals of two usual ones or more.
"""

from __future__ import annotations

import itertools
import json
import statistics
import sys
import time
from functools import partial
from typing import Any

import rclpy
from geometry_msgs.msg import PoseStamped, TwistStamped
from rclpy.executors import SingleThreadedExecutor
from sensor_msgs.msg import JointState

ARMS = ("PSM1", "PSM2", "PSM3", "ECM", "MTML", "MTMR")
TOPICS = {"measured_js": JointState, "setpoint_js": JointState, "measured_cp": PoseStamped, "setpoint_cp": PoseStamped,
          "measured_cv": TwistStamped}
SETTLE_S = 3.0


def main() -> None:
    """`sys.argv`: see above."""
    rclpy.init()
    executor = SingleThreadedExecutor()
    node, came = rclpy.create_node("latency"), dict[str, list[tuple[float, float]]]()

    def take(name: str, message: Any) -> None:
        stamp = message.header.stamp
        came[name].append((stamp.sec * 1e3 + stamp.nanosec * 1e-6, node.get_clock().now().nanoseconds * 1e-6))

    for arm in ARMS:
        for topic, kind in TOPICS.items():
            name = f"/{arm}/{topic}"
            came[name] = []
            node.create_subscription(kind, name, partial(take, name), int(sys.argv[2]))
    executor.add_node(node)
    for seconds in (SETTLE_S, float(sys.argv[1])):
        for rows in came.values():
            rows.clear()
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            executor.spin_once(timeout_sec=0.1)
    ages = sorted(at - stamp for rows in came.values() for stamp, at in rows if stamp)
    gaps = 0
    for rows in came.values():
        steps = [after[0] - before[0] for before, after in itertools.pairwise(rows)]
        usual = statistics.median(steps) if steps else 0.0
        gaps += sum(step > 1.9 * usual for step in steps)
    print(json.dumps({"messages": len(ages), "per_topic_s": len(ages) / len(came) / seconds, "gaps": gaps,
                      "silent_topics": sum(not rows for rows in came.values()),
                      "age_ms": {f"p{p}": ages[len(ages) * p // 100] for p in (50, 90, 99)} if ages else {}}))


if __name__ == "__main__":
    main()
