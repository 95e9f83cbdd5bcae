"""What a mailbox and its owner say to a command at first, for stand-ins: by the code that real ones use."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import numpy as np

from shm.guard import unauthorized
from shm.origins import Origin
from tests.command_rows import row_named


def objection(kind: str, name: str, values: Any, text: str, origin: Origin, void: int = 0) -> str:
    """Why it is refused, "": it is not. `void`: commands of an earlier fault generation count for nothing."""
    row, numbers = row_named(name, kind), np.asarray(values, dtype=np.float64).reshape(-1)
    cell = SimpleNamespace(void=void, spared=0)
    return unauthorized(row, text, numbers, origin, cell) or row.objection(numbers)
