"""Validity of numbers in records: those whose flag is true may be shown.

A record is still published while its subject is absent, with the last valid values or zeros.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Final

import numpy as np

from trocar.procs.crtk.field_paths import FieldCells
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.robots import IoRobot, Place, robots_of
from trocar.shm.system.directory import topic_of
from trocar.shm.topics import IO_STATE

ALONE: Final = -1
"""Index for a flag that is not a list."""
ALWAYS: Final = ("", ALONE)
FROM_BOARDS: Final = frozenset({"powered", "amps_on", "watchdog", "power_fault", "relay", "brakes_released",
                                "board_period"})
"""For a robot as a whole, reported by its boards; io itself knows the rest, for example that boards are absent."""
PINS: Final = frozenset({"input", "output"})
"""Of no robot in particular: known while all boards are there."""


def flags_of(kind: str, ring: str) -> dict[str, str]:
    """By field of a record, the flag that its CRTK views name for it."""
    try:
        views = topic_of(kind, ring).views
    except KeyError:
        return {}
    return {field: view.where for view in views for part, field in view.fields if part != "name" and view.where}


def checked(document: SystemConfig, instance: str, ring: str, cells: FieldCells, dtype: np.dtype[Any]) -> FieldCells:
    """One number of the records of a ring, with the flag that marks it as valid."""
    kind = next((row.kind for row in document.processes if row.name == instance), "")
    place = int(cells.flat[0])
    if kind == "io":
        robots = [robot for robot in robots_of(document) if robot.io.name == instance]
        flag, row = _of_robot(robots, cells.field.name, place) if ring == IO_STATE.name else ALWAYS
    else:
        flag, row = flags_of(kind, ring).get(cells.field.name, ""), ALONE
        if flag and dtype[flag].shape:  # one for each setup arm, as its numbers
            row = place * _count(dtype[flag]) // _count(dtype[cells.field.name])
    return dataclasses.replace(cells, flag=flag, flag_row=row)


def _of_robot(robots: list[IoRobot], field: str, place: int) -> tuple[str, int]:
    """Whether the boards of the robot with this number are present."""
    if field in PINS:
        return "valid", ALONE
    for robot in robots:
        cut = robot.cuts(IO_STATE.fields).get(field)
        if cut is not None and _holds(cut, place):
            return ALWAYS if isinstance(cut, int) and field not in FROM_BOARDS else ("robot_valid", robot.place)
    return ALWAYS


def _holds(cut: Place, place: int) -> bool:
    if isinstance(cut, slice):
        return bool(cut.start <= place < cut.stop)
    return place == cut if isinstance(cut, int) else place in cut


def _count(cell: np.dtype[Any]) -> int:
    return int(np.prod(cell.shape))
