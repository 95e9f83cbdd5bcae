"""What `trocar attach` prints where there is no terminal, or with `--once`: every page as a table, once."""

from __future__ import annotations

from trocar.tools.inspect import standing
from trocar.tools.inspect.processes import COLUMNS, RIGHT, cells
from trocar.tools.monitor.events import EventRow
from trocar.tools.monitor.snapshot import snapshot
from trocar.tools.output.printing import number, span, table, tell

EVENTS_SHOWN, COMMANDS_SHOWN = 8, 8


def print_once(system: str) -> None:
    """All of a system."""
    shot = snapshot(system)
    seen = shot.overview
    rates = [(row.name, number(row.nominal_hz, "g") if row.nominal_hz else "on events", number(row.hz, ".1f"),
              number(row.max_ms, ".2f"), span(row.age_s), row.problem) for row in shot.topics]
    asked = [tuple(row.cells[:3] + ["under way"] + row.cells[4:]) for row in reversed(shot.under_way)]
    asked += [tuple(row.cells) for row in list(reversed(shot.commands))[:COMMANDS_SHOWN]]
    table(f"system {seen.system}, {seen.words}, clock {seen.clock}", standing.COLUMNS,
          [standing.cells(one) for one in seen.standings])
    tell(seen.first)
    table("events, newest first", ("at", "from", "event", "text"),
          [(row.at, row.who, row.what, row.text) for row in _once_each(shot.events)])
    table("", (*COLUMNS[:-1], "CPU %", "MB", COLUMNS[-1]),
          [(*cells(row.status)[:-1], number(row.cpu_percent), number(row.memory_mb, ".0f"), row.status.problem)
           for row in shot.processes], (*RIGHT, "CPU %", "MB"))
    table("topics", ("topic", "declared", "Hz", "longest ms", "age", "problem"), rates,
          ("declared", "Hz", "longest ms", "age"))
    table("commands, newest first", ("at", "asked", "for", "outcome", "whose", "reason"), asked)


def _once_each(events: list[EventRow]) -> list[EventRow]:
    """The newest events, the newest first; what was reported several times stands there once."""
    newest = {(row.who, row.what, row.text): row for row in events}
    return sorted(newest.values(), key=lambda row: row.order, reverse=True)[:EVENTS_SHOWN]
