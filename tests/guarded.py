"""What a mailbox and its owner say to a command at first, for stand-ins: by the code that real ones use."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tests.command_rows import row_named
from trocar.shm.mailbox.generations import Cell
from trocar.shm.mailbox.guard import authorizes, late, unauthorized
from trocar.shm.mailbox.mailbox_map import MAX_TEXT, MAX_VALUES
from trocar.shm.mailbox.origins import NO_ORIGIN, Origin

UNAUTHORIZED = "not authorized: needs an operator's command given after the last fault, power-off or hold"


@dataclass
class FakeCell:
    """Faults of one component, each of which is a generation."""

    valid_from: int = 0
    exempt_origin: int = 0

    def fault(self) -> None:
        """See FaultCell."""
        self.valid_from, self.exempt_origin = self.valid_from + 1, 0

    def void_earlier(self, origin: Origin) -> None:
        """See FaultCell."""
        exempt = origin.id if authorizes(origin, self) else 0
        self.valid_from, self.exempt_origin = self.valid_from + 1, exempt


def objection(kind: str, name: str, values: Any, text: str, origin: Origin, valid_from: int = 0,
              exempt_origin: int = 0, waited_ns: int = 0) -> str:
    """Why it is refused, "": it is not. `valid_from`: commands of an earlier fault generation count for nothing."""
    row, numbers = row_named(name, kind), np.asarray(values, dtype=np.float64).reshape(-1)
    if len(numbers) > MAX_VALUES or len(text.encode()) > MAX_TEXT:
        return f"{len(numbers)} values and {len(text)} characters; allowed are {MAX_VALUES} and {MAX_TEXT}"
    cell = FakeCell(valid_from, exempt_origin)
    return (late(row, text, numbers, waited_ns) or unauthorized(row, text, numbers, origin, cell)
            or row.objection(numbers))


class Guarded:
    """The way to a mailbox, for a process that was just begun: nobody's until `on_behalf`."""

    def __init__(self, kind: str, cell: Cell) -> None:
        """`cell` of the owner's component."""
        self.kind, self.cell, self.origin = kind, cell, NO_ORIGIN
        self.refused: list[str] = []

    def on_behalf(self, origin: Origin) -> None:
        """What comes from now on are steps of this command."""
        self.origin = origin

    @property
    def is_authorized(self) -> bool:
        """Whether an operator's command stands behind what is sent."""
        return bool(self.origin.id)

    def lets_through(self, name: str, values: Sequence[float], text: str) -> bool:
        """Whether the owner sees this command; what it does not is kept in `refused`."""
        reason = objection(self.kind, name, values, text, self.origin, self.cell.valid_from, self.cell.exempt_origin)
        if reason:
            self.refused.append(f"{name} {text} {tuple(values)}: {reason}")
        return not reason
