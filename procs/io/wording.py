"""Faults as sentences: which robot, axis and board, what is wrong, what was measured and what is allowed."""

from __future__ import annotations

import math
from collections.abc import Sequence

from procs.lib.faults import Fault


def place(robot: str, axis: str = "", boards: Sequence[int] = ()) -> str:
    """Where: `PSM1 axis 2 (insertion), board 6`; what is not known is left out."""
    where = f"{robot} {axis}".strip()
    if not boards:
        return where
    numbers = f"board{'s' if len(boards) > 1 else ''} {', '.join(map(str, boards))}"
    return f"{where}, {numbers}" if where else numbers


def figures(fault: Fault, value: float, limit: float, unit: str) -> str:
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
