"""An endoscope's focus on emulated boards: a pedal, a command, a lock, and a death."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests import stock
from tests.system.robot import Robot, wait_for
from trocar.shm.mailbox.client import Client
from trocar.shm.system import directory

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
OUTPUTS = ("endoscope_focus_in", "endoscope_focus_out")


def test_a_pedal_moves_the_lens_and_a_death_stops_it(robot: Robot, tmp_path: Path) -> None:
    pedals = stock.find("dvrk-share/io/sawRobotIO1394-MTMR-foot-pedals-QLA1.json")
    rows = [{"name": name, "board_id": 2, "bit_id": bit, "is_PWM": False} for bit, name in enumerate(OUTPUTS)]
    (tmp_path / "focus.json").write_text(
        json.dumps({"$id": "saw-robot-io.schema.json", "$version": "6", "digital_outputs": rows}))
    file = tmp_path / "lens.json"
    file.write_text(json.dumps({
        "$id": "dvrk-system.schema.json", "$version": "1",
        "IOs": [{"name": "IO1", "port": "udp", "configuration_files": [str(pedals)]}],
        "ISI_focus_controller": {"name": "lens", "IO": "IO1", "IO_file": "focus.json"}}))
    robot.up(file, "--boards", "emulated")
    state = directory.reader(robot.name, "IO1", "state", "io")
    lens = directory.reader(robot.name, "lens", "state", "focus")
    boards, client = Client(robot.name, "boards"), Client(robot.name, "lens")
    places = [state.info["outputs"].index(name) for name in OUTPUTS]

    def pins(*levels: bool) -> None:
        wait_for(lambda: state.newest() and tuple(state.field("output")[places].tolist()) == levels, 60, f"{levels}")

    pins(True, True)
    boards.send("press", (1,), "focus_plus")
    pins(False, True)
    old = robot.kill("lens")
    pins(False, True)
    boards.send("press", (0,), "focus_plus")  # while nobody looks
    pins(True, True)
    client.close()
    wait_for(lambda: robot.pid("lens") != old and robot.state("lens") == "RUNNING", 60, "its restart")
    client = Client(robot.name, "lens")
    client.send("focus_out", (1,))
    pins(True, False)
    client.send("lock", (1,))
    pins(True, True)
    wait_for(lambda: lens.newest() and bool(lens.field("locked")), 60, "it says that it is locked")
    for part in (state, lens, boards, client):
        part.close()
    assert robot.down() == 0
