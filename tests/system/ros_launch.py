"""Run by an interpreter that has rclpy, with the path of a launch file: prints the nodes that it would start.

PyPI has no wheels of launch and launch_ros; what a launch file takes of them is played here.
"""

from __future__ import annotations

import json
import runpy
import sys
import types
from typing import Any

ARGUMENTS = {"arm": "PSM1", "namespace": ""}


def main() -> None:
    """Load it, and call what it wants to be called."""
    names = ("launch", "launch.actions", "launch.substitutions", "launch_ros", "launch_ros.actions")
    made = [sys.modules.setdefault(name, types.ModuleType(name)) for name in names]
    launch, actions, substitutions, _, ros_actions = made
    nodes: list[Any] = []
    played: Any
    for module, played in (
            (launch, {"LaunchDescription": list}),
            (actions, {"DeclareLaunchArgument": lambda name, **given: ("argument", name),
                       "OpaqueFunction": lambda function: ("function", function)}),
            (substitutions, {"LaunchConfiguration": lambda name: types.SimpleNamespace(
                perform=lambda context: ARGUMENTS[name])}),
            (ros_actions, {"Node": dict})):
        vars(module).update(played)
    for kind, what in runpy.run_path(sys.argv[1])["generate_launch_description"]():
        if kind == "function":
            nodes += what(None)
        else:
            assert what in ARGUMENTS
    print(json.dumps(nodes))


if __name__ == "__main__":
    main()
