"""Several IO files of one bus add up, wherever they are named, and may not take each other's names."""

from __future__ import annotations

import json
from typing import Any

import pytest

from tests.config.conftest import Home

INPUT = {"board_id": 3, "bit_id": 0, "pressed_value": True, "trigger_when_pressed": True, "trigger_when_released": True}
KINDS: dict[str, dict[str, Any]] = {
    "digital_inputs": INPUT,
    "digital_outputs": {"board_id": 3, "bit_id": 0},
    "dallas_chips": {"board_id": 3},
}


def io_file(home: Home, file: str, **lists: list[dict[str, Any]]) -> str:
    head = {"$id": "saw-robot-io.schema.json", "$version": "6"}
    (home.path / file).write_text(json.dumps({**head, **lists}))
    return file


def bus(*files: str, name: str = "IO1") -> dict[str, Any]:
    return {"name": name, "port": "udp", "configuration_files": list(files)}


def test_files_of_one_bus_add_up_in_their_order(home: Home) -> None:
    first = io_file(home, "a.json", digital_inputs=[{**INPUT, "name": "clutch"}],
                    dallas_chips=[{"board_id": 3, "name": "d"}])
    second = io_file(home, "b.json", digital_inputs=[{**INPUT, "name": "coag", "bit_id": 1}],
                     digital_outputs=[{"name": "lamp", "board_id": 4, "bit_id": 0}])
    pedals = io_file(home, "c.json", digital_inputs=[{**INPUT, "name": "camera", "bit_id": 2}])
    console = {"name": "console", "input_type": "PEDALS_ONLY", "IO_pedals": {"IO": "IO1", "IO_file": pedals}}
    loaded = home.load_made({"IOs": [bus(first, second)], "consoles": [console]})
    assert loaded.system is not None, loaded.errors
    io = loaded.system.ios[0]
    assert [i.name for i in io.digital_inputs] == ["clutch", "coag", "camera"]
    assert [o.name for o in io.digital_outputs] == ["lamp"] and [r.name for r in io.instrument_readers] == ["d"]


def test_a_file_that_is_named_twice_counts_once(home: Home) -> None:
    pedals = io_file(home, "c.json", digital_inputs=[{**INPUT, "name": "camera"}])
    console = {"name": "console", "input_type": "PEDALS_ONLY", "IO_pedals": {"IO": "IO1", "IO_file": pedals}}
    loaded = home.load_made({"IOs": [bus(pedals)], "consoles": [console]})
    assert loaded.system is not None, loaded.errors
    assert [i.name for i in loaded.system.ios[0].digital_inputs] == ["camera"]


@pytest.mark.parametrize("kind", KINDS)
def test_names_are_unique_across_the_files_of_a_bus(home: Home, kind: str) -> None:
    first = io_file(home, "a.json", **{kind: [{**KINDS[kind], "name": "same"}]})
    second = io_file(home, "b.json", **{kind: [{**KINDS[kind], "name": "same"}]})
    (problem,) = home.load_made({"IOs": [bus(first, second)]}).errors
    assert problem.key == f"{kind}[0].name" and problem.file.endswith("b.json") and "a.json:" in problem.text


def test_another_bus_may_use_the_same_names(home: Home) -> None:
    first = io_file(home, "a.json", digital_inputs=[{**INPUT, "name": "same"}])
    second = io_file(home, "b.json", digital_inputs=[{**INPUT, "name": "same"}])
    loaded = home.load_made({"IOs": [bus(first), {**bus(second, name="IO2"), "port": "udp:169.254.0.101"}]})
    assert loaded.system is not None, loaded.errors
    assert [[i.name for i in io.digital_inputs] for io in loaded.system.ios] == [["same"], ["same"]]
