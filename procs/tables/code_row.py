"""A row of the table of codes (`trocar.procs.tables.codes`): a warning or an error, with cause and remedy."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

WARNING: Final = 2
ERROR: Final = 3
NOTHING: Final = 0
STOP: Final = 1  # joint controller off, zero current
POWER_OFF: Final = 2  # and amplifiers and motor power off
CUT: Final = 3  # and the safety relays opened

JOINT: Final = "joint"


@dataclass(frozen=True, slots=True, eq=False)
class Code:
    """One row: `cause` describes the problem in one sentence, `remedy` the actions to take.

    `owner`: the kinds of process that report it, or "any". For faults of io: `action` is NOTHING, STOP, POWER_OFF or
    CUT; `unit` is that of value and limit, JOINT: rad or m by axis, empty: no value; `bound` describes the limit.
    """

    code: str
    severity: int
    owner: str
    cause: str
    remedy: str
    number: int = 0
    action: int = NOTHING
    unit: str = ""
    bound: str = "allowed"

    def remedy_for(self, component: str) -> str:
        """The remedy, with the name of the arm or process concerned."""
        return self.remedy.replace("NAME", component) if component else self.remedy
