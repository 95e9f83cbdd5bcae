"""Setup joints as processes of whole systems: base frames for others, killed, clutched, from stock files."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tests.system.robot import ROOT, Robot, wait_for
from trocar.shm.system import directory

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
CART = ROOT / "configs/systems/kinematic-cart.yaml"
LOCKSTEP = ("--set", "clock=lockstep")


def echo(robot: Robot, topic: str) -> dict:
    return json.loads(robot.trocar("echo", topic, "--json", "--once"))


def test_killed_set_up_joints_leave_arms_without_base_until_they_are_back(robot: Robot) -> None:
    robot.up(CART, "--set", "processes.SUJ.backoff_s=2")
    robot.trocar("power-on")
    robot.trocar("home")
    robot.trocar("send", "SUJ", "servo_jp", "0.1", "0.2", "1.5", "-0.1", "0.4", "0", "PSM2")
    robot.trocar("send", "SUJ", "set_reference_arm", "PSM1")
    wait_for(lambda: echo(robot, "PSM2/state")["reference_frame"] == "PSM1", 60, "a base frame in PSM1")
    before = echo(robot, "PSM2/state")["base_frame"]
    arm = directory.reader(robot.name, "PSM2", "state")
    assert arm.newest()
    first = arm.head
    old = robot.kill("SUJ")
    wait_for(lambda: not arm.last(arm.head - first)["reference_valid"].all(), 60, "an unknown base")
    wait_for(lambda: robot.pid("SUJ") != old and robot.state("SUJ") == "RUNNING", 60, "the restart")
    wait_for(lambda: arm.newest() and arm.field("reference_valid").item(), 60, "the base")
    assert np.allclose(arm.field("base_frame"), before, atol=1e-9), "joints and reference arm as before"
    history = arm.last(arm.head - first)
    assert history["is_homed"].all() and history["cartesian_valid"].all(), "local poses stay"
    arm.close()
    state = echo(robot, "SUJ/state")
    assert (state["state"], state["is_homed"], state["reference_arm"]) == ("ENABLED", True, "PSM1")


def test_classic_set_up_joints_of_a_site_are_read_and_clutched(robot: Robot, data: Callable[[str], Path]) -> None:
    robot.up(data("dvrk-site/jhu-daVinci/system-SUJ.json"), "--path", str(data("dvrk-share")), "--boards", "emulated",
             *LOCKSTEP)
    robot.trocar("power-on")
    robot.trocar("home")
    cart = directory.reader(robot.name, "SUJ", "state")

    def known(*expected: bool) -> bool:
        return cart.newest() and cart.field("setup_valid").tolist() == list(expected)

    wait_for(lambda: known(True, True, True, True), 120, "three rounds of the multiplexer")
    robot.trocar("send", "boards", "press", "1", "SUJ_clutch_2")
    wait_for(lambda: known(True, False, True, True) and cart.field("brake_current")[1] == 2.2, 60, "the clutch")
    robot.trocar("send", "boards", "press", "0", "SUJ_clutch_2")
    wait_for(lambda: known(True, True, True, True) and not cart.field("brake_current").any(), 120, "rest")
    cart.close()
    assert len(echo(robot, "SUJ/PSM1/measured_js")["position"]) == 6
    assert len(echo(robot, "SUJ/ECM/primary_voltage/measured_js")["position"]) == 6
    robot.trocar("power-off")
    assert echo(robot, "SUJ/operating_state")["state"] == "DISABLED"


GOLDEN = {
    "ECM": ("Cart", (0.055999, 1.156901, 0.908821, 0.923635, -0.022072, -0.009141, 0.382527)),
    "PSM1": ("ECM", (-0.062668, -0.075188, 0.009377, 0.277057, 0.206014, -0.270271, 0.89875)),
    "PSM2": ("ECM", (0.081629, -0.041172, 0.011897, 0.326857, 0.148334, -0.813917, 0.456838)),
    "PSM3": ("ECM", (0.139604, -0.126381, 0.028876, 0.184702, 0.306649, -0.873956, 0.328714)),
}


@pytest.mark.soak  # tests/suj has the same numbers
def test_stock_full_system_shows_tips_where_the_original_does(robot: Robot, data: Callable[[str], Path]) -> None:
    robot.up(data("dvrk-share/system/system-full-system-simulated.json"), "--path", str(data("dvrk-share")),
             *LOCKSTEP)
    robot.trocar("power-on", *GOLDEN, "SUJ")
    robot.trocar("home", *GOLDEN, "SUJ")
    robot.trocar("send", "ECM", "move_jp", "0", "0", "0.12", "0")
    wait_for(lambda: abs(echo(robot, "ECM/measured_js")["position"][2] - 0.12) < 1e-9, 60, "the move")
    for name, (frame, pose) in GOLDEN.items():
        state = echo(robot, f"{name}/state")
        assert (state["reference_frame"], state["reference_valid"]) == (frame, True), name
        assert np.allclose(state["measured_cp"], pose, atol=1e-6), name
    robot.trocar("send", "ECM", "state_command", "disable")
    wait_for(lambda: not echo(robot, "PSM1/state")["reference_valid"], 20, "an unknown base without the ECM's tip")
    assert echo(robot, "PSM1/state")["cartesian_valid"] and echo(robot, "ECM/state")["reference_valid"] is False
