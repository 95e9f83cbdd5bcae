"""How processes ended is read from the supervisor's records."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from trocar.tools.inspect.processes import KEPT, PastProcess, endings

IO = ("IO1", 10, "")


def records(*states: tuple[tuple[str, int, str], ...]) -> NDArray[Any]:
    """Records of the supervisor at 1, 2, 3… ns: name, process and last reason of each instance."""
    count = len(states[0])
    made = np.zeros(len(states), [("stamp_ns", "<i8"), ("instance", "S64", count), ("pid", "<u4", count),
                                  ("exit_reason", "S120", count)])
    for number, state in enumerate(states, start=1):
        made[number - 1] = (number, *zip(*state, strict=True))
    return made


@pytest.mark.parametrize("between", [(), ((IO, ("PSM1", 0, "killed by SIGKILL")),)], ids=["at once", "later"])
def test_each_process_that_was_there_is_told_with_its_end(between: Any) -> None:
    told = endings(records((IO, ("PSM1", 11, "")), *between, (IO, ("PSM1", 12, "killed by SIGKILL")),
                           (IO, ("PSM1", 0, "stopped"))))
    assert told == {"PSM1": (PastProcess(11, 2, "killed by SIGKILL"), PastProcess(12, 3 + len(between), "stopped"))}


def test_of_many_endings_the_newest_are_told() -> None:
    told = endings(records(*((("PSM1", 100 + n, f"exit code {n}"),) for n in range(KEPT + 6))))["PSM1"]
    assert len(told) == KEPT and told[-1] == PastProcess(100 + KEPT + 4, KEPT + 6, f"exit code {KEPT + 5}")
