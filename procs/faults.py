"""Faults as they are told, and what the table of codes says of a number in `fault` of io's record."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

from procs.codes import FAULTS, IO_FAULT, Code


@dataclass(frozen=True, slots=True)
class FaultReport:
    """One fault as it is told: a sentence about whom it is and what happened, and the same as data. No code: none.

    Axes count from 0; -1 and NaN: there is none.
    """

    code: Code | None = None
    text: str = ""
    axis: int = -1
    board: int = -1
    value: float = math.nan
    limit: float = math.nan

    @property
    def words(self) -> str:
        """What happened, and what a person can do."""
        return f"{self.text}; {self.code.remedy}" if self.code else self.text


NO_FAULT: Final = FaultReport()


def reported(number: int) -> FaultReport:
    """What the table alone says of a latched fault."""
    fault = fault_of(number)
    if fault is None:
        return FaultReport(IO_FAULT, f"io reports fault {number}")
    return FaultReport(fault, fault.cause)


def fault_of(number: int) -> Code | None:
    """The row of a fault number; None for 0 and for numbers nobody knows."""
    return next((row for row in FAULTS if row.number == number), None)
