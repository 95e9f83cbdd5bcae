"""The focus controller of a system file."""

from __future__ import annotations

import json

import pytest

from tests import stock
from tests.config.conftest import Home
from trocar.procs.config import Loaded
from trocar.procs.document.system import Focus, WiredInput, from_json, to_json

PEDALS = "dvrk-share/io/sawRobotIO1394-MTMR-foot-pedals-QLA1.json"


def load(home: Home, *outputs: str, name: str = "lens", pedals: bool = True, key: object = None) -> Loaded:
    rows = [{"name": output, "board_id": 2, "bit_id": bit, "is_PWM": False} for bit, output in enumerate(outputs)]
    (home.path / "focus.json").write_text(
        json.dumps({"$id": "saw-robot-io.schema.json", "$version": "6", "digital_outputs": rows}))
    files = [str(stock.find(PEDALS))] if pedals else []
    focus = {"name": name, "IO": "IO1", "IO_file": "focus.json"}
    return home.load_made({"IOs": [{"name": "IO1", "port": "udp", "configuration_files": files}],
                           "ISI_focus_controller": key or focus}, boards="emulated")


def test_it_has_two_outputs_and_the_pedals_of_the_foot_tray(home: Home) -> None:
    system = load(home, "endoscope_focus_in", "endoscope_focus_out").system
    assert system is not None
    assert system.focuses == (Focus("lens", 0.01, "IO1", ("endoscope_focus_in", "endoscope_focus_out"),
                                    (WiredInput("IO1", "focus_plus"), WiredInput("IO1", "focus_minus"))),)
    assert system.process("lens").kind == "focus" and system.process("lens").after == ("IO1",)
    assert from_json(to_json(system)) == system


def test_without_pedals_commands_move_it(home: Home) -> None:
    system = load(home, "endoscope_focus_in", "endoscope_focus_out", pedals=False).system
    assert system is not None and system.focuses[0].pedals == ()
    assert "lens: no pedals focus_plus and focus_minus, only commands move the lens" in system.notes


@pytest.mark.parametrize(("outputs", "name", "key", "says"), [
    (("endoscope_focus_in",), "lens", "IO_file", "has no digital output endoscope_focus_out"),
    ((), "lens", "IO_file", "has no digital output endoscope_focus_in, endoscope_focus_out"),
    (("endoscope_focus_in", "endoscope_focus_out"), "IO1", "name", "not a unique name"),
    (("endoscope_focus_in", "endoscope_focus_out"), "my lens", "name", "not a unique name")])
def test_mistakes_stop_the_start(home: Home, outputs: tuple[str, ...], name: str, key: str, says: str) -> None:
    (error,) = load(home, *outputs, name=name).errors
    assert error.key == f"ISI_focus_controller.{key}" and says in error.text
