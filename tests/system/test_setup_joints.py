"""Setup joints as processes of whole systems: base frames for others, killed, clutched, from stock files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml

from tests.system.robot import AT_250_HZ, ROOT, Robot, wait_for
from tests.system.robot_in_host import HOSTED
from tests.system.test_kinematic import echo
from trocar.shm.system import directory

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
CART = ROOT / "configs/systems/kinematic-cart.yaml"


def test_killed_set_up_joints_leave_arms_without_base_until_they_are_back(robot: Robot, tmp_path: Path) -> None:
    cart = yaml.safe_load(CART.read_text())
    cart["arms"] = [arm for arm in cart["arms"] if arm["name"] in ("SUJ", "PSM1", "PSM2")]
    (tmp_path / "cart.yaml").write_text(yaml.safe_dump(cart))
    robot.up(tmp_path / "cart.yaml", "--path", str(ROOT / "configs"), "--set", "processes.SUJ.backoff_s=0.5")
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


@pytest.mark.simulated(HOSTED)
def test_classic_set_up_joints_of_a_site_are_read_and_clutched(robot: Robot, data: Callable[[str], Path]) -> None:
    robot.up(data("dvrk-site/jhu-daVinci/system-SUJ.json"), "--path", str(data("dvrk-share")), "--boards", "emulated",
             *AT_250_HZ)
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
