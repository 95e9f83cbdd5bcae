"""Fault reports as data and as sentences: location, cause, measured value and limit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from trocar.procs.document.system import Actuator, Brake, IoConfig
from trocar.procs.tables.code_row import Code
from trocar.procs.tables.codes import FAULTS, IO_FAULT


@dataclass(frozen=True, slots=True)
class FaultReport:
    """One fault: a sentence with location and cause, and the same as data. Without `code` there is no fault.

    Axes count from 0; -1 and NaN mean not applicable.
    """

    code: Code | None = None
    text: str = ""
    axis: int = -1
    board: int = -1
    value: float = math.nan
    limit: float = math.nan

    def words(self, component: str) -> str:
        """The cause of the fault, and the remedy for this arm or process."""
        return f"{self.text}; {self.code.remedy_for(component)}" if self.code else self.text


NO_FAULT: Final = FaultReport()


def reported(number: int) -> FaultReport:
    """The report of a latched fault by its number alone, from the table of codes."""
    fault = fault_of(number)
    if fault is None:
        return FaultReport(IO_FAULT, f"io reports fault {number}")
    return FaultReport(fault, fault.cause)


def fault_of(number: int) -> Code | None:
    """The row of a fault number; None for 0 and for unknown numbers."""
    return next((row for row in FAULTS if row.number == number), None)


def place(robot: str, axis: str = "", boards: Sequence[int] = ()) -> str:
    """The location of a fault: `PSM1 axis 2 (insertion), board 6`; unknown parts are left out."""
    where = f"{robot} {axis}".strip()
    if not boards:
        return where
    numbers = f"board{'s' if len(boards) > 1 else ''} {', '.join(map(str, boards))}"
    return f"{where}, {numbers}" if where else numbers


def axis_titles(io: IoConfig) -> list[list[str]]:
    """For each robot, readable names of its axes, `axis 2 (insertion)`, then its brakes; numbered as in commands."""
    named = {pid.robot: [axis.name.replace("_", " ") for axis in pid.axes] for pid in io.pids}
    found = []
    for robot in io.robots:
        motors = len(robot.actuators)
        names = named.get(robot.name, [""] * motors)[:motors]
        names += [f"brake {i}" for i in range(len(robot.brakes))]
        found.append([f"axis {i} ({name})" if name else f"axis {i}" for i, name in enumerate(names)])
    return found


def boards_of(drive: Actuator | Brake) -> tuple[int, ...]:
    """The board of a motor or brake; empty without boards."""
    return (drive.board_id,) if drive.board_id >= 0 else ()


def figures(fault: Code, value: float, limit: float, unit: str) -> str:
    """Measured value and limit in `unit`; empty without a value or a unit.

    Uses 4 or 6 digits, as needed to distinguish the two; if 6 do not suffice, the value is "just above" or "below".
    """
    if math.isnan(value) or not fault.unit:
        return ""
    digits = next((n for n in (4, 6) if f"{value:.{n}g}" != f"{limit:.{n}g}"), 0)
    near = "" if digits else "just above " if value > limit else "just below " if value < limit else ""
    digits = digits or 6
    allowed = f", {fault.bound} {limit:.{digits}g}{_after(unit)}" if not math.isnan(limit) else ""
    return f"{near}{value:.{digits}g}{_after(unit)}{allowed}"


def _after(unit: str) -> str:
    return f" {unit}" if unit else ""


def sentence(where: str, what: str, *details: str) -> str:
    """A fault as one sentence, without the remedy."""
    reported_text = "; ".join(detail for detail in details if detail)
    return f"{where}: {what}" + (f" ({reported_text})" if reported_text else "")
