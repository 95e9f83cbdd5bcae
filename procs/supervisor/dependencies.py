"""Who needs whom: the order in which the processes of a system start; they stop in reverse. Pure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from trocar.procs.document.system import Process
from trocar.procs.supervisor.children import Child
from trocar.procs.tables import lifecycle


class Circle(ValueError):
    """Some wait for each other; the message names them."""


def waves(rows: Sequence[Process]) -> list[list[Process]]:
    """Rows in start order: each wave needs only instances of earlier ones. Circle when there is none."""
    found: list[list[Process]] = []
    left, up = list(rows), set[str]()
    known = {row.name for row in rows}
    while left:
        wave = [row for row in left if all(name in up or name not in known for name in row.after)]
        if not wave:
            raise Circle(f"{', '.join(row.name for row in left)}: each waits for another to start first")
        found.append(wave)
        up |= {row.name for row in wave}
        left = [row for row in left if row.name not in up]
    return found


def missing(child: Child, children: Mapping[str, Child]) -> list[str]:
    """What an instance needs and nobody is going to start; one that runs goes on without."""
    if child.state != lifecycle.STOPPED:
        return []
    return [name for name in child.row.after if name in children and children[name].is_down]
