"""Which process may run on which cores: each bus has one to itself, what moves robots comes next, the rest keeps away.

Only where time is real, boards are, and there are four cores or more; a `cpu` that a file gives to a process counts
before all that. The first cores are for everything else, as those are where interrupts and other programs usually run.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from trocar.procs.tables.manifest import Proc

LEAST: Final = 4
ROBOTS: Final = ("io", "arm", "above arms")
"""Whose priority is one of these moves robots; an io without boards needs no core of its own."""
Core = tuple[int, ...]
"""Numbers of the processors that are one core (with hyper-threading two)."""


@dataclass(frozen=True, slots=True)
class Placement:
    """Processors by number; empty: any."""

    ios: Mapping[str, Core] = field(default_factory=dict)
    robots: tuple[int, ...] = ()
    others: tuple[int, ...] = ()

    def of(self, kind: Proc, name: str) -> tuple[int, ...]:
        """Of an instance."""
        return self.ios.get(name) or (self.robots if kind.priority in ROBOTS else self.others)


def placed(cores: Sequence[Core], ios: Mapping[str, int | None]) -> Placement:
    """`ios`: each bus, with the processor that a file gives it. Nobody is placed on fewer than LEAST cores."""
    if len(cores) < LEAST or not ios:
        return Placement()
    taken = {cpu for cpu in ios.values() if cpu is not None}
    free = [core for core in cores if not taken & set(core)]
    unplaced = [name for name, cpu in ios.items() if cpu is None]
    own = free[max(len(free) - len(unplaced), 2) :]  # two are left at least: for robots, and for the others
    if len(free) < 2 or len(own) < len(unplaced):
        return Placement()  # more buses than cores
    rest = free[: len(free) - len(own)]
    count = max(1, len(rest) // 3)
    return Placement({name: core[:1] for name, core in zip(unplaced, own, strict=True)}, _all(rest[count:]),
                     _all(rest[:count]))


def _all(cores: Sequence[Core]) -> tuple[int, ...]:
    return tuple(sorted(cpu for core in cores for cpu in core))
