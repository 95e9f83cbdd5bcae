"""What the processes of a system were asked for, by whom, and what became of it: their audit rings as one list."""

from __future__ import annotations

from typing import Any

from trocar.shm.system import directory
from trocar.tools.inspect.messages import time_of_day
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import number, plain

AUDIT = "audit"


def rows_of(system: str, instance: str | None, most: int) -> tuple[list[dict[str, Any]], int]:
    """The newest `most` of all processes, or of one, oldest first, and how many are older.

    Problem: the process takes no commands, or the system is down.
    """
    rings, found, count = directory.rings(system), [], 0
    if not any(topic == AUDIT for _, topic in rings):
        raise Problem(f"{system} is down: commands are kept while the system is up; recordings have them: "
                      "trocar recordings, trocar logs --commands --recording FILE")
    for name, topic in rings:
        if topic == AUDIT and instance in (None, name):
            ring = directory.reader(system, name, AUDIT)
            kept = ring.last(ring.depth)
            count += len(kept)
            found += [{"process": name, **_plain(row)} for row in kept[len(kept) - min(most, len(kept)):]]
            ring.close()
    if not found and instance is not None and (instance, AUDIT) not in rings:
        raise Problem(f"{instance}: there is no such process, or it takes no commands; trocar status lists them")
    found.sort(key=lambda row: row["monotonic_ns"])
    shown = found[len(found) - min(most, len(found)):]
    return shown, count - len(shown)


def _plain(row: Any) -> dict[str, Any]:
    found = {name: plain(row[name]) for name in row.dtype.names if name not in ("sequence", "count")}
    return found | ({"values": found["values"][: int(row["count"])]} if "values" in found else {})


def in_words(row: dict[str, Any]) -> str:
    """One line: when, who was asked, for what, the outcome, whose command that was."""
    values = (row.get("values") or ())[: row.get("count")]
    words = (row["command"], row["text"], *(number(value, ".6g") for value in values))
    asked = " ".join(filter(None, words))
    why = f" ({row['reason']})" if row["reason"] else ""
    whose = f"{row['program'] or 'a program'}, number {row['origin']:x}, generation {row['generation']}"
    through = f" by pid {row['pid']}" if row["pid"] else ""
    return (f"{time_of_day(row['local_ns'])}  {row['process']}: {asked}: {row['outcome']}{why}; "
            f"{f'for {whose}' if row['origin'] else 'for nobody'}{through}")
