"""Lookup tables of digital potentiometers: `{"serial": …, "lookup": [a row of 4096 positions for each actuator]}`.

A row may also be `{"from": …, "to": …}`: 4096 positions evenly between the two, for robots without measurements.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np

from trocar.procs.config.loading.context import Opened
from trocar.procs.config.models.io_file import IoFile, RobotKeys
from trocar.procs.config.read.problem import KeyPath
from trocar.procs.config.read.search import expanded
from trocar.procs.fpga import lookup

Tables: TypeAlias = dict[tuple[Path, KeyPath], str]
"""Packed tables by path of the IO file and key of the robot."""
ROW: Final = f"{lookup.ENTRIES} numbers a row, or {{from, to}} within ±{lookup.MISSING_ABOVE:g}"


def load_tables(opened: Opened[IoFile]) -> Tables:
    """The packed tables of a file's robots with DIGITAL potentiometers.

    A table is searched in a `path` of the robot, in the folder of the IO file, and on the search path.
    """
    tables: Tables = {}
    beside = opened.source.path.parent
    for robot in opened.each("robots", opened.content.robots):
        pots = robot.content.potentiometers
        if pots is None or pots.potentiometers_type != "DIGITAL":
            continue
        key = "potentiometers.lookup_table_file"
        if not pots.lookup_table_file:
            robot.error(key, "this key is required for DIGITAL potentiometers", "a file")
            continue
        path = robot.find(key, pots.lookup_table_file, beside=(*map(expanded, robot.content.path), beside),
                          stage="tables")
        table = _table(robot, key, path) if path is not None else ""
        if table:
            tables[opened.source.path, robot.key] = table
    return tables


def check_table(table: Opened[None]) -> None:
    """Check a table by itself: its rows, and the serial number, which must be in its name."""
    serial = table.source.at(("serial",))
    if not isinstance(serial, str) or not serial or serial not in table.source.path.name:
        table.error("serial", "the name of the file must contain it", "the text of a serial number")
    _packed(table)


def _table(robot: Opened[RobotKeys], key: str, path: Path) -> str:
    """The packed table; empty, with errors, when the file is not this robot's."""
    serial, name = robot.content.serial, robot.content.name
    if serial not in path.name:
        text = f"the name of a table must contain the robot's serial number {serial}: it may be another arm's"
        robot.error(key, text, f"*{serial}*.json")
    table = robot.context.read(path)
    if table is None:
        return ""
    if table.source.at(("serial",)) != serial:
        table.error("serial", f"is not that of robot {name}", serial)
    rows, count = table.source.at(("lookup",)), len(robot.content.actuators)
    if isinstance(rows, list) and len(rows) != count:
        table.error("lookup", "wrong number of rows", f"{count}, one an actuator of {name}")
        return ""
    return _packed(table)


def _packed(table: Opened[None]) -> str:
    """The rows of a table as text; empty, with an error, when they are not valid."""
    rows = table.source.at(("lookup",))
    rows = [_spread(row) for row in rows] if isinstance(rows, list) else []
    if not rows or not all(isinstance(row, list) for row in rows):
        table.error("lookup", "must be a list of rows", ROW)
        return ""
    try:
        return lookup.pack(rows)
    except ValueError as error:
        table.error("lookup", str(error), ROW)
        return ""


def _spread(row: Any) -> Any:
    """The positions for `from` and `to`; any other row unchanged."""
    if not isinstance(row, dict) or set(row) != {"from", "to"}:
        return row
    first, last = row["from"], row["to"]
    if not all(type(end) in (int, float) and abs(end) <= lookup.MISSING_ABOVE for end in (first, last)):
        return row
    return np.linspace(first, last, lookup.ENTRIES).tolist()
