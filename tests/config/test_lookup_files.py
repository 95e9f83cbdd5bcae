"""Tables of digital potentiometers: which robot gets which, and what is said of those that are none."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.config.test_spoiled_files import DRIVE, HEAD, source_of
from trocar.procs.config.loading.context import Context, Opened
from trocar.procs.config.models.io_file import IoFile
from trocar.procs.config.models.lookup_file import Tables, check_table, load_tables
from trocar.procs.config.read.search import search_path
from trocar.procs.config.read.validate import validate
from trocar.procs.fpga import lookup

KEY = "potentiometers.lookup_table_file"
ROW = [0.001 * reading for reading in range(lookup.ENTRIES)]


def robot(name: str, kind: str = "DIGITAL", file: str = "", count: int = 1, **changes: Any) -> dict[str, Any]:
    actuators = [{"board_id": 0, "axis_id": axis, "drive": DRIVE} for axis in range(count)]
    return {"name": name, "serial_number": name, "hardware_version": "dRA1", "number_of_actuators": count,
            "number_of_brakes": 0, "actuators": actuators,
            "potentiometers": {"potentiometers_type": kind, "lookup_table_file": file}, **changes}


def loaded(folder: Path, *robots: dict[str, Any]) -> tuple[Tables, list[str]]:
    """The tables of an IO file with these robots, and what is wrong."""
    source = source_of({**HEAD, "robots": list(robots)}, str(folder / "io.json"))
    content, problems = validate(IoFile, source)
    assert content is not None and not problems, problems
    context = Context(search_path((folder / "search",)))
    tables = load_tables(Opened(context, source, content))
    return tables, [f"{Path(problem.file).name} {problem.key}: {problem.text}" for problem in context.problems]


def check(context: Context, path: Path) -> None:
    found = context.read(path)
    if found is not None:
        check_table(found)


def table(folder: Path, name: str, rows: Any, serial: str) -> str:
    (folder / name).write_text(json.dumps({"serial": serial, "lookup": rows}))
    return name


def test_each_robot_gets_its_own_table_whatever_the_ones_before_lack(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    (tmp_path / "search").mkdir()
    beside = table(tmp_path, "table-E.json", [ROW, {"from": 0.0, "to": 4.095}], "E")
    table(tmp_path / "sub", "table-F.json", [ROW], "F")
    table(tmp_path / "search", "table-G.json", [ROW], "G")
    tables, said = loaded(
        tmp_path, robot("A", "ANALOG"), robot("B", "NONE", "x.json"), robot("C"), robot("D", file="nowhere-D.json"),
        robot("E", file=beside, count=2), robot("F", file="table-F.json", path=[str(tmp_path / "sub")]),
        robot("G", file="table-G.json"), {**robot("H"), "potentiometers": None})
    assert sorted(key[1] for _, key in tables) == [4, 5, 6] and {path.name for path, _ in tables} == {"io.json"}
    both = lookup.unpack(tables[tmp_path / "io.json", ("robots", 4)], 2)
    assert both == pytest.approx(np.array((ROW, ROW)))
    assert said[0] == f"io.json robots[2].{KEY}: this key is required for DIGITAL potentiometers"
    assert said[1].startswith(f"io.json robots[3].{KEY}: no file nowhere-D.json") and len(said) == 2


@pytest.mark.parametrize(("name", "rows", "serial", "tables", "said"), [
    ("table-P.json", [ROW], "P", 1, []),
    ("table.json", [ROW], "P", 1, [f"io.json robots[0].{KEY}: the name of a table must contain the robot's serial "
                                   "number P: it may be another arm's"]),
    ("table-P.json", [ROW], "Q", 1, ["table-P.json serial: is not that of robot P"]),
    ("table-P.json", [ROW, ROW], "P", 0, ["table-P.json lookup: wrong number of rows"]),
    ("table-P.json", [], "P", 0, ["table-P.json lookup: wrong number of rows"]),
    ("table-P.json", 7, "P", 0, ["table-P.json lookup: must be a list of rows"]),
    ("table-P.json", [7], "P", 0, ["table-P.json lookup: must be a list of rows"]),
    ("table-P.json", [ROW[:-1]], "P", 0, ["table-P.json lookup: lookup[0]: 4095 entries; allowed: 4096 finite "
                                          "numbers"]),
    ("table-P.json", [{"from": 0.0, "to": 31.0}], "P", 1, []),
    ("table-P.json", [{"from": -31.0, "to": 0}], "P", 1, []),
    ("table-P.json", [{"from": 0.0, "to": 31.1}], "P", 0, ["table-P.json lookup: must be a list of rows"]),
    ("table-P.json", [{"from": True, "to": 1.0}], "P", 0, ["table-P.json lookup: must be a list of rows"]),
    ("table-P.json", [{"from": 0.0}], "P", 0, ["table-P.json lookup: must be a list of rows"])])
def test_a_table_is_a_row_of_positions_for_each_actuator(tmp_path: Path, name: str, rows: Any, serial: str, tables: int,
                                                         said: list[str]) -> None:
    table(tmp_path, name, rows, serial)
    found, problems = loaded(tmp_path, robot("P", file=name))
    assert len(found) == tables and problems == said


@pytest.mark.parametrize(("serial", "said"), [("P", ""), ("Q", "must contain it"), ("", "must contain it"),
                                              (7, "must contain it")])
def test_a_table_by_itself_has_its_serial_number_in_its_name(tmp_path: Path, serial: Any, said: str) -> None:
    table(tmp_path, "table-P.json", [ROW], serial)
    context = Context(search_path((tmp_path,)))
    check(context, tmp_path / "table-P.json")
    assert [said in problem.text for problem in context.problems] == [True] * bool(said)
    check(context, tmp_path / "nothing.json")
    assert len(context.problems) == bool(said) + 1
    table(tmp_path, "other-P.json", 7, "P")
    check(context, tmp_path / "other-P.json")
    assert context.problems[-1].text == "must be a list of rows"
