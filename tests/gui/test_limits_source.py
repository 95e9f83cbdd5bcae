"""Joints within their ranges, and the goal of a move."""

from __future__ import annotations

from contextlib import closing

import numpy as np

from tests.conftest import World
from tests.tools.robot import robot
from trocar.procs.document.system import from_json
from trocar.procs.gui.limits_source import LATE_NS, TRAJECTORY, LimitsSource
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns


def test_the_goal_is_shown_while_a_move_is_under_way(world: World) -> None:
    with robot(world.name) as scripted:
        audit = directory.writer(world.name, "PSM1", "audit", "arm")

        def note(command: str, outcome: str, values: list[float]) -> None:
            audit.field("command")[...], audit.field("outcome")[...] = command.encode(), outcome.encode()
            audit.field("count")[...] = len(values)
            audit.field("values")[:len(values)] = values
            audit.publish(monotonic_ns())

        note("move_jp", "accepted", [0.1] * 3)
        document = from_json(directory.document(world.name))
        with closing(audit), closing(LimitsSource(document)) as source:
            now = monotonic_ns()
            assert source.read(now)["arms"]["PSM1"] == {"names": [], "late": True}
            scripted.arm.field("tool")[...] = b"TEST:1"
            scripted.show_arm(0.12345678)
            found = source.read(now)["arms"]["PSM1"]
            assert len(found["names"]) == 6 and found["slides"] == [False] * 6
            assert found["lower"] == [-1.0] * 6 and found["upper"] == [1.0] * 6
            assert found["q"][0] == 0.1235 and found["goal"] == [] and not found["late"]
            note("move_jp", "accepted", [0.5] * 6)
            note("move_jp", "refused", [0.9] * 6)
            note("crtk_version", "done", [])
            scripted.arm.field("control_mode")[...] = TRAJECTORY
            scripted.show_arm(0.2)
            assert source.read(now)["arms"]["PSM1"]["goal"] == [0.5] * 6
            for command in ("move_cp", "hold", "state_command", "servo_jp"):
                note("move_jp", "accepted", [0.5] * 6)
                note(command, "accepted", [0.1] * 6)
                scripted.show_arm(0.2)
                assert source.read(now)["arms"]["PSM1"]["goal"] == [], f"the goal before {command}"
            note("move_jp", "accepted", [0.4] * 6)
            modes = []
            for mode in (TRAJECTORY, 1, TRAJECTORY):
                scripted.arm.field("control_mode")[...] = mode
                scripted.show_arm(0.2)
                modes.append(source.read(now)["arms"]["PSM1"]["goal"])
            assert modes == [[0.4] * 6, [], []], "another move, of which nothing is known"
            scripted.arm.field("control_mode")[...] = 1
            scripted.show_arm(np.nan)
            found = source.read(now)["arms"]["PSM1"]
            assert found["goal"] == [] and found["q"][0] is None
            assert source.read(now + 2 * LATE_NS)["arms"]["PSM1"]["late"]
