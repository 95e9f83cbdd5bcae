"""Our own systems for every kind of arm on emulated boards: they start, power on and home."""

from __future__ import annotations

import json

import pytest

from tests.system.robot import ROOT, Robot

pytestmark = [pytest.mark.slow, pytest.mark.soak]  # sites' own arms home in test_homing.py
KINDS = {"demo-psm-si": ("PSM1",), "demo-ecm-si": ("ECM",)}  # demo-ecm and demo-mtm home in test_arm_deaths.py


@pytest.mark.parametrize("name", KINDS)
def test_arms_of_every_kind_home_on_emulated_boards(robot: Robot, name: str) -> None:
    robot.up(ROOT / f"configs/systems/{name}.yaml")
    robot.trocar("power-on")
    robot.home()
    for arm in KINDS[name]:
        assert json.loads(robot.trocar("echo", f"{arm}/operating_state", "--json", "--once"))["is_homed"] is True
    assert robot.down() == 0
