"""Another try of what failed: only where the machine was too busy, as the system or the program itself reported.

Each try but the first is counted; pytest prints the total at its end, and fails where there were more than `BUDGET`.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import pytest

from trocar.procs.tables import codes
from trocar.shm.memory.segment import SegmentError
from trocar.tools.output.errors import Problem

CAUSES: Final = (codes.HELD_UP, codes.PROCESS_LATE, codes.PERIOD, codes.PERIOD_LONG, codes.BOARDS_LATE)
"""What a process, io, the supervisor or emulated boards report when they had no core in time."""
TOO_BUSY: Final = re.compile("|".join((r"stalled for \d", *(r"\S+".join(map(re.escape, code.remedy.split("NAME")))
                                                            for code in CAUSES))))
MOST: Final = 5
BUDGET: Final = 25
made: list[str] = []
"""One line for each try but the first."""


class NewText:
    """What is appended to files from now on."""

    def __init__(self, files: Callable[[], Iterable[Path]]) -> None:
        """`files` are those there are at the moment."""
        self._files = files
        self._sizes = {path: path.stat().st_size for path in files()}

    def text(self) -> str:
        """All of it."""
        found = (path.read_bytes()[self._sizes.get(path, 0):] for path in self._files())
        return b"\n".join(found).decode(errors="replace")


def retry(attempt: Callable[[], str], files: Callable[[], Iterable[Path]], what: str) -> str:
    """Try until `attempt` returns no problem, or one without such a cause: the last problem, and what was written.

    `files`: what the system writes.
    """
    for number in range(MOST):
        written = NewText(files)
        problem = attempt()
        if not problem:
            return ""
        problem = f"{problem}\n{written.text()}"
        cause = TOO_BUSY.search(problem)
        if cause is None or number == MOST - 1:
            break
        made.append(f"{what}: {cause[0]}")
    return f"{what}, try {number + 1}: {problem}"


def measured(monkeypatch: pytest.MonkeyPatch, folder: Path, run: Callable[[], Mapping[str, Any]],
             is_enough: Callable[[Mapping[str, Any]], bool]) -> Mapping[str, Any]:
    """What a benchmark measures, with its logs in a folder, where the machine was not too busy for it."""
    figures: Mapping[str, Any] = {}
    monkeypatch.setenv("TROCAR_STATE", str(folder))

    def attempt() -> str:
        nonlocal figures
        try:
            figures = run()
        except (Problem, SegmentError) as problem:
            return str(problem)
        return "" if is_enough(figures) else f"measured: {figures}"

    problem = retry(attempt, lambda: folder.rglob("*.log"), "a benchmark")
    assert not problem, problem
    return figures
