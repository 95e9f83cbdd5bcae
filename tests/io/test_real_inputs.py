"""Grippers, pedals and sensors of real sites on emulated boards."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from tests import stock
from tests.io.boards_harness import COARSE, BoardsHarness
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.config import load_system

TELEOP = "dvrk-site/jhu-dVRK/system-MTML-PSM1-Teleop.json"
CONTACT = "dvrk-site/jhu-dVRK/sawRobotIO1394-PSM2-contact-sensor.json"
PEDALS = "dvrk-share/io/sawRobotIO1394-MTMR-foot-pedals-QLA1.json"


def rig_of(path: Path) -> tuple[BoardsHarness, BoardFaults]:
    loaded = load_system(path, search=[stock.find("dvrk-share")], boards="emulated", sets=COARSE)
    assert loaded.errors == () and loaded.system is not None
    harness = BoardsHarness(loaded.system)
    return harness, BoardFaults(harness.world, harness.plant)


def buttons(harness: BoardsHarness, name: str) -> list[str]:
    """What was reported of an input since the last time."""
    reported = [event.text for event in harness.events if event.kind == "button" and event.component == name]
    harness.events.clear()
    return reported


@pytest.mark.slow
def test_a_master_its_gripper_and_the_pedals_work_side_by_side() -> None:
    harness, hand = rig_of(stock.find(TELEOP))
    harness.bring_up("MTML")
    gripper = harness.robots.slices[harness.robots.names.index("MTML_gripper")]
    pedals = [i.name for i in harness.io.digital_inputs]
    voltage = harness.record.pot_position[gripper].copy()
    hand.place("MTML_gripper", np.array([0.3]))
    harness.run(0.1)
    assert abs(float(harness.record.pot_position[gripper][0]) - 0.3) < 0.02 and abs(float(voltage[0]) - 0.3) > 0.05
    buttons(harness, "clutch")
    hand.press("clutch", True)
    harness.run(0.5)
    assert harness.record.input[pedals.index("clutch")] and buttons(harness, "clutch") == ["pressed"]
    hand.press("clutch", False)
    harness.run(0.5)
    assert not harness.record.input[pedals.index("clutch")] and buttons(harness, "clutch") == ["released"]
    hand.press("clutch", True)
    harness.run(0.05)  # shorter than its debounce time
    hand.press("clutch", False)
    harness.run(0.5)
    assert buttons(harness, "clutch") == ["clicked"]
    assert harness.errors() == [] and harness.record.pid_enabled[harness.robots.names.index("MTML")]


def test_inputs_without_any_robot_are_read_and_told(tmp_path: Path) -> None:
    files = [str(stock.find(name)) for name in (CONTACT, PEDALS)]
    (tmp_path / "inputs.json").write_text(json.dumps(
        {"$id": "dvrk-system.schema.json", "$version": "1",
         "IOs": [{"name": "bus", "port": "udp", "configuration_files": files}]}), encoding="utf-8")
    harness, hand = rig_of(tmp_path / "inputs.json")
    assert harness.robots.names == ()
    names = [i.name for i in harness.io.digital_inputs]
    harness.run(0.3)
    contact = harness.io.digital_inputs[names.index("PSM2_contact")]
    assert contact.pressed_value is False, "it pulls its line down"
    buttons(harness, "PSM2_contact")
    for pressed, word in ((True, "pressed"), (False, "released")):
        hand.press("PSM2_contact", pressed)
        harness.run(0.05)
        assert bool(harness.record.input[names.index("PSM2_contact")]) is pressed
        assert buttons(harness, "PSM2_contact") == [word]
    assert harness.errors() == []
