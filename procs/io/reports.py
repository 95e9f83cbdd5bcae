"""io's reports: faults and events of a cycle, collected first and handled together."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from trocar.procs.node import fault_report as faults
from trocar.procs.tables import codes
from trocar.procs.tables.code_row import Code


@dataclass(frozen=True, slots=True)
class IoEvent:
    """One event for the event ring; `kind` is status, warning, error, button or tool_type."""

    kind: str
    text: str
    code: str = ""
    component: str = ""
    axis: int = -1
    value: float = math.nan
    limit: float = math.nan
    board: int = -1
    hint: str = ""


@dataclass(frozen=True, slots=True)
class IoFaultReport:
    """One fault found in this cycle: robot and axis by index (axis within the robot, -1: none).

    `boards` are the faulty ones where the fault is not the axis's alone.
    """

    fault: Code
    robot: int
    axis: int = -1
    value: float = math.nan
    limit: float = math.nan
    detail: str = ""
    boards: tuple[int, ...] = ()


def also(bad: NDArray[np.bool_]) -> str:
    """The axes after the first of `bad`, for which a trip has no field."""
    more = np.flatnonzero(bad)[1:].tolist()
    return f"also axis {', '.join(map(str, more))}" if more else ""


class IoReports:
    """Events wait for the loop, which empties the list after publishing; trips wait for the end of the checks."""

    def __init__(self) -> None:
        self.events: list[IoEvent] = []
        self.trips: list[IoFaultReport] = []
        self.detached: list[str] = []
        """In-cycle tasks that were detached, and why: shown as a problem of io until io is created again."""
        self.changed: set[str] = set()
        """Topics besides `state` with a changed record: the loop publishes them, and empties the set."""

    def status(self, text: str, component: str = "", axis: int = -1) -> None:
        """Report information for operators."""
        self.events.append(IoEvent("status", text, component=component, axis=axis))

    def warn(self, fault: Code, component: str, value: float = math.nan, limit: float = math.nan, sender: str = "",
             boards: tuple[int, ...] = ()) -> None:
        """Report a warning of the fault table, with `sender` inserted in its text; switches nothing off."""
        measured = faults.figures(fault, value, limit, fault.unit)
        text = faults.sentence(faults.place(component, boards=boards), fault.cause.replace(codes.SENDER, sender),
                                measured)
        board = boards[0] if boards else -1
        self.events.append(IoEvent("warning", text, fault.code, component, -1, value, limit, board,
                                   fault.remedy_for(component)))

    def trip(self, fault: Code, robot: int, axis: int = -1, value: float = math.nan, limit: float = math.nan,
             detail: str = "", boards: tuple[int, ...] = ()) -> None:
        """Report a fault of the table; its devices are off before anything is written."""
        self.trips.append(IoFaultReport(fault, robot, axis, value, limit, detail, boards))

    def trip_axes(self, fault: Code, robot: int, bad: NDArray[np.bool_], values: NDArray[np.float64] | float = math.nan,
                  limits: NDArray[np.float64] | float = math.nan) -> None:
        """The same for the axes of a robot that are `bad`: a trip for the first, which names the others."""
        axis = int(np.argmax(bad))
        value, limit = (float(each[axis]) if isinstance(each, np.ndarray) else each for each in (values, limits))
        self.trip(fault, robot, axis, value, limit, also(bad))
