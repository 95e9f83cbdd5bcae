"""How the processes of a system ended, one after the other: from the records that the supervisor keeps of states."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from numpy.typing import NDArray

from trocar.tools.output.printing import plain

KEPT: Final = 20  # of one instance; the supervisor keeps its last 256 changes of all


@dataclass(frozen=True, slots=True)
class PastProcess:
    """One that has ended: its number, when that was seen by the system's clock, and how, in words."""

    pid: int
    stamp_ns: int
    text: str


def endings(records: NDArray[Any]) -> dict[str, tuple[PastProcess, ...]]:
    """Of each instance, oldest first, at most KEPT.

    `records` are those of the supervisor's topic `state`, oldest first. A process has ended where the next record has
    another process for its instance, or none.
    """
    found: dict[str, list[PastProcess]] = {}
    pids: dict[str, int] = {}
    for record in records:
        stamp_ns = int(record["stamp_ns"])
        columns = (plain(record[field]) for field in ("instance", "pid", "exit_reason"))
        for name, pid, text in zip(*columns, strict=True):
            before, pids[name] = pids.get(name, 0), int(pid)
            if before and before != pid:
                found.setdefault(name, []).append(PastProcess(before, stamp_ns, text))
    return {name: tuple(rows[-KEPT:]) for name, rows in found.items()}
