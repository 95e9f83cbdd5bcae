"""Faults as sentences: which robot, axis and board, what is wrong, what was measured and what is allowed."""

from __future__ import annotations

import math
from collections.abc import Sequence

from procs.codes import Code
from procs.document.system import Actuator, Brake, IoConfig


def place(robot: str, axis: str = "", boards: Sequence[int] = ()) -> str:
    """Where: `PSM1 axis 2 (insertion), board 6`; what is not known is left out."""
    where = f"{robot} {axis}".strip()
    if not boards:
        return where
    numbers = f"board{'s' if len(boards) > 1 else ''} {', '.join(map(str, boards))}"
    return f"{where}, {numbers}" if where else numbers


def axis_titles(io: IoConfig) -> list[list[str]]:
    """Of every robot its axes for people, `axis 2 (insertion)`, then its brakes; numbers are those of commands."""
    named = {pid.robot: [axis.name.replace("_", " ") for axis in pid.axes] for pid in io.pids}
    found = []
    for robot in io.robots:
        motors = len(robot.actuators)
        names = named.get(robot.name, [""] * motors)[:motors]
        names += [f"brake {i}" for i in range(len(robot.brakes))]
        found.append([f"axis {i} ({name})" if name else f"axis {i}" for i, name in enumerate(names)])
    return found


def boards_of(drive: Actuator | Brake) -> tuple[int, ...]:
    """The board of a motor or brake; none where there are no boards."""
    return (drive.board_id,) if drive.board_id >= 0 else ()


def figures(fault: Code, value: float, limit: float, unit: str) -> str:
    """What was measured and what is allowed, in `unit`; empty where nothing was."""
    if math.isnan(value) or not fault.unit:
        return ""
    allowed = f", {fault.bound} {limit:.4g}{_after(unit)}" if not math.isnan(limit) else ""
    return f"{value:.4g}{_after(unit)}{allowed}"


def _after(unit: str) -> str:
    return f" {unit}" if unit else ""


def sentence(where: str, what: str, *details: str) -> str:
    """One sentence without the remedy."""
    said = "; ".join(detail for detail in details if detail)
    return f"{where}: {what}" + (f" ({said})" if said else "")
