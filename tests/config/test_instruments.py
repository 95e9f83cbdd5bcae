"""Tool indexes and tool files: all instruments of the indexes, one of them, and what is wrong with them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from tests import stock
from tests.config.conftest import Home
from trocar.procs.config import check_file, load_system
from trocar.procs.document import system as document

ARM = "arms/PSM1-demo.yaml"
TOOL = "tool/LARGE_NEEDLE_DRIVER_400006.yaml"
INDEX = "tool/index.yaml"


def choosing(home: Home, *rows: dict[str, object]) -> None:
    """The demo's arm may choose; these rows are an index of its own, mine.yaml."""
    home.edit(ARM, 'tool_detection: FIXED\ntool: "LARGE_NEEDLE_DRIVER:400006"',
              "tool_detection: MANUAL\ncustom_tool_index: mine.yaml")
    (home.path / "tool/mine.yaml").write_text(yaml.safe_dump({"instruments": [dict(row) for row in rows]}))


def row(name: str, model: str, file: str = "LARGE_NEEDLE_DRIVER_400006.yaml", **more: object) -> dict[str, object]:
    return {"model": model, "names": [name], "description": "", "generation": "Classic", "file": file, **more}


def test_all_instruments_that_have_a_file_can_be_chosen() -> None:
    path = stock.find("dvrk-site/jhu-dVRK/system-PSM1.json")
    share = stock.find("dvrk-share")
    system = load_system(path, search=[share], boards="emulated").system
    assert system is not None
    there = {file.stem for file in (share / "tool").glob("*.json")} - {"index"}
    tools = {Path(tool.source).stem: tool for tool in system.arms[0].tools}
    assert set(tools) == there
    assert tools["LARGE_NEEDLE_DRIVER_420006"].name == "LARGE_NEEDLE_DRIVER:420006[..11]"
    assert (tools["NEEDLE_DRIVER_400117"].snake, len(tools["NEEDLE_DRIVER_400117"].links)) == (True, 5)
    assert tools["LARGE_NEEDLE_DRIVER_400006"].description == "Large Needle Driver"
    assert len(document.to_json(system)) < 80_000


def test_instruments_without_a_file_are_noted(home: Home) -> None:
    choosing(home, row("NEW_THING", "400999", "nowhere.json"), row("OTHER", "400998"))
    loaded = home.load()
    assert loaded.system is not None and loaded.warnings == ()
    assert [tool.name for tool in loaded.system.arms[0].tools] == [
        "OTHER:400998", "LARGE_NEEDLE_DRIVER:400006", "LARGE_NEEDLE_DRIVER:420006[..11]"]
    (note,) = [note for note in loaded.system.notes if "cannot be chosen" in note]
    assert note.startswith("PSM1: 1 of 4 ") and "nowhere.json" in note


def test_an_index_of_ones_own_hides_the_stock_one(home: Home) -> None:
    home.edit(TOOL, "jaw: {qmin: -0.698132", "jaw: {qmin: -0.6")
    (home.path / "tool/mine").mkdir()
    mine = (home.path / TOOL).read_text().replace("qmin: -0.6,", "qmin: -0.1,")
    (home.path / "tool/mine.tool.yaml").write_text(mine)
    choosing(home, row("LARGE_NEEDLE_DRIVER", "400006", "mine.tool.yaml"))
    system = home.load().system
    assert system is not None
    assert [(tool.name, tool.jaw.lower) for tool in system.arms[0].tools][:1] == [("LARGE_NEEDLE_DRIVER:400006", -0.1)]
    assert len(system.arms[0].tools) == 2


def test_all_mistakes_of_all_instruments_are_told(home: Home) -> None:
    spoilt = (home.path / TOOL).read_text().replace("qmin: -0.698132", "qmin: 7")
    (home.path / "tool/spoilt.yaml").write_text(spoilt)
    choosing(home, row("A", "1", "spoilt.yaml"))
    problem = home.error()
    assert problem.file.endswith("tool/spoilt.yaml") and problem.key == "jaw.qmin" and problem.line > 0


@pytest.mark.parametrize(("rows", "key", "text"), [
    ((row("A", "1"), row("A", "1")), "instruments[1].model", "listed twice"),
    ((row("A", "1", version_max=4), row("A", "1", version_min=4)), "instruments[1].model", "listed twice"),
    ((row("A", "1", version_min=4, version_max=3),), "instruments[0].version_max", "below version_min"),
    ((row("A:B", "1"),), "instruments[0].names[0]", "not allowed"),
    ((row("A", "1", version_min=-1),), "instruments[0].version_min", "out of range")])
def test_an_index_that_cannot_be_meant_is_refused(
        home: Home, rows: tuple[dict[str, object], ...], key: str, text: str) -> None:
    choosing(home, *rows)
    problem = home.error()
    assert problem.file.endswith("mine.yaml") and problem.key == key and text in problem.text


def test_versions_side_by_side_are_one_instrument_each(home: Home) -> None:
    choosing(home, row("A", "1", version_max=4), row("A", "1", version_min=5))
    system = home.load().system
    assert system is not None
    assert [tool.name for tool in system.arms[0].tools][:2] == ["A:1[..4]", "A:1[5..]"]


def test_a_model_with_several_versions_needs_one(home: Home) -> None:
    choosing(home, row("A", "1", version_max=4), row("A", "1", version_min=5))
    home.edit(ARM, "tool_detection: MANUAL", 'tool_detection: FIXED\ntool: "A:1"')
    problem = home.error()
    assert problem.key == "tool" and "specify one" in problem.text and problem.allowed == "A:1[..4], A:1[5..]"
    home.edit(ARM, 'tool: "A:1"', 'tool: "A:1[7]"')
    system = home.load().system
    assert system is not None and system.arms[0].tool is not None and system.arms[0].tool.version_min == 5
    assert system.arms[0].tools == (system.arms[0].tool,), "the others are not read"


def test_a_name_with_underscores_only_is_noted(home: Home) -> None:
    home.edit(ARM, "LARGE_NEEDLE_DRIVER:400006", "LARGE_NEEDLE_DRIVER_400006")
    loaded = home.load()
    assert loaded.system is not None and loaded.system.arms[0].tool is not None
    assert loaded.system.arms[0].tool.name == "LARGE_NEEDLE_DRIVER:400006"
    assert any("taken as LARGE_NEEDLE_DRIVER:400006" in note for note in loaded.system.notes)
    assert any("taken as" in note for note in check_file(home.path / ARM).notes)


def test_keys_of_older_tool_files_are_read(home: Home) -> None:
    text = (home.path / TOOL).read_text()
    old = text.replace("tooltip_offset", "tooltip-offset").replace("tool_engage_position", "tool-engage-position")
    (home.path / TOOL).write_text(old)
    system = home.load().system
    assert system is not None and system.arms[0].tool is not None
    assert system.arms[0].tool.engage_lower == (-4.5378, -0.261799, -0.261799, 0)
    line = home.edit(TOOL, "- [0, 0, 1, 0]", "- [0, 0, 1.1, 0]")
    assert home.error().line in (line, line - 2)


def test_every_file_of_a_checked_index_is_checked(home: Home) -> None:
    home.edit(TOOL, "qmin: -0.698132", "qmin: 7")
    result = check_file(home.path / INDEX)
    assert [problem.key for problem in result.problems] == ["jaw.qmin"]
    home.edit(INDEX, "file: LARGE", "file: SMALL")
    (problem,) = check_file(home.path / INDEX).problems
    assert (problem.key, problem.severity) == ("instruments[0].file", "warning")


def test_documents_hold_every_instrument_once() -> None:
    path = stock.find("dvrk-site/jhu-dVRK/system-PSM1.json")
    system = load_system(path, search=[stock.find("dvrk-share")], boards="emulated").system
    assert system is not None
    text = document.to_json(system)
    assert len(json.loads(text)["instruments"]) == len(system.arms[0].tools) == 17
    again = document.from_json(text)
    assert again == system and again.arms[0].tools[0] == system.arms[0].tools[0]
    with pytest.raises(ValueError, match="not readable"):
        document.from_json(text.replace(b'"known":[[0,', b'"known":[[999,'))
