"""Which commands may power or home something: bridges pass them on where the system file lets them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from shm.commands import CommandRow

_ALL: Final = frozenset[str]()
_STATES: Final = frozenset({"state_command"})
POWERING: Final = {"io": _ALL, "boards": _ALL, "supervisor": _ALL, "arm": _STATES, "third_party": _STATES,
                   "suj": _STATES, "system": frozenset({"power_on", "home"})}
"""By kind of process; empty: all."""


def powers(kind: str, row: CommandRow, values: Sequence[float], text: str) -> bool:
    """Whether a command to a process of this kind may power or home; what only ends something does not."""
    named = POWERING.get(kind)
    return named is not None and (not named or row.name in named) and row.needs_person(text, values)
