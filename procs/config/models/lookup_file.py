"""Lookup tables of digital potentiometers: `{"serial": …, "lookup": [a row of 4096 positions for each actuator]}`.

A row may also be `{"from": …, "to": …}`: 4096 positions evenly between the two, for robots without measurements.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np

from trocar.procs.config.loading.context import Context, Opened
from trocar.procs.config.models.io_file import IoFile, RobotKeys
from trocar.procs.config.read.problem import KeyPath
from trocar.procs.config.read.search import expanded
from trocar.procs.fpga import lookup

ROW: Final = f"{lookup.ENTRIES} numbers a row, or {{from, to}} within ±{lookup.MISSING_ABOVE:g}"


def load_tables(opened: Opened[IoFile]) -> dict[tuple[Path, int], str]:
    """The packed tables of a file's robots with DIGITAL potentiometers, by path and index of the robot.

    A table is searched in a `path` of the robot, in the folder of the IO file, and on the search path.
    """
    tables: dict[tuple[Path, int], str] = {}
    beside = opened.source.path.parent
    for index, robot in enumerate(opened.content.robots):
        pots = robot.potentiometers
        if pots is None or pots.potentiometers_type != "DIGITAL":
            continue
        key: KeyPath = ("robots", index, "potentiometers", "lookup_table_file")
        if not pots.lookup_table_file:
            opened.error(key, "this key is required for DIGITAL potentiometers", "a file")
            continue
        path = opened.find(key, pots.lookup_table_file, beside=(*(expanded(text) for text in robot.path), beside))
        table = _table(opened, key, robot, path) if path is not None else ""
        if table:
            tables[opened.source.path, index] = table
    return tables


def check_table(context: Context, path: Path) -> None:
    """Check a table by itself: its rows, and the serial number, which must be in its name."""
    table = context.read(path)
    if table is None:
        return
    serial = table.source.at(("serial",))
    if not isinstance(serial, str) or not serial or serial not in path.name:
        table.error(("serial",), "the name of the file must contain it", "the text of a serial number")
    _packed(table)


def _table(opened: Opened[IoFile], key: KeyPath, robot: RobotKeys, path: Path) -> str:
    """The packed table; empty, with errors, when the file is not this robot's."""
    serial = robot.serial_number
    if serial not in path.name:
        text = f"the name of a table must contain the robot's serial number {serial}: it may be another arm's"
        opened.error(key, text, f"*{serial}*.json")
    table = opened.context.read(path)
    if table is None:
        return ""
    if table.source.at(("serial",)) != serial:
        table.error(("serial",), f"is not that of robot {robot.name}", serial)
    rows, count = table.source.at(("lookup",)), len(robot.actuators)
    if isinstance(rows, list) and len(rows) != count:
        table.error(("lookup",), "wrong number of rows", f"{count}, one an actuator of {robot.name}")
        return ""
    return _packed(table)


def _packed(table: Opened[None]) -> str:
    """The rows of a table as text; empty, with an error, when they are not valid."""
    rows = table.source.at(("lookup",))
    rows = [_spread(row) for row in rows] if isinstance(rows, list) else []
    if not rows or not all(isinstance(row, list) for row in rows):
        table.error(("lookup",), "must be a list of rows", ROW)
        return ""
    try:
        return lookup.pack(rows)
    except ValueError as error:
        table.error(("lookup",), str(error), ROW)
        return ""


def _spread(row: Any) -> Any:
    """The positions for `from` and `to`; any other row unchanged."""
    if not isinstance(row, dict) or set(row) != {"from", "to"}:
        return row
    first, last = row["from"], row["to"]
    if not all(type(end) in (int, float) and abs(end) <= lookup.MISSING_ABOVE for end in (first, last)):
        return row
    return np.linspace(first, last, lookup.ENTRIES).tolist()
