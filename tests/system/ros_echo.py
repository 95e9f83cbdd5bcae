"""Run by an interpreter that has rclpy: sends back on /back/NAME what comes on /there/NAME, until it is killed."""

from __future__ import annotations

import importlib
import sys
from functools import partial

import rclpy


def main() -> None:
    """`sys.argv` has the types, as ROS writes them."""
    rclpy.init()
    node = rclpy.create_node("echo")
    for name in sys.argv[1:]:
        package, kind, what = name.split("/")
        message = getattr(importlib.import_module(f"{package}.{kind}"), what)
        back = node.create_publisher(message, f"/back/{what}", 10)
        node.create_subscription(message, f"/there/{what}", partial(type(back).publish, back), 10)
    print("ready", flush=True)
    rclpy.spin(node)


if __name__ == "__main__":
    main()
