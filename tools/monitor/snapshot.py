"""All data of the monitor, as one document or as text: for programs, pipes and mails."""

from __future__ import annotations

import dataclasses
from contextlib import closing
from typing import Any

from trocar.procs.crtk.topics import RECORD
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.inspect import standing
from trocar.tools.inspect.processes import COLUMNS, RIGHT, cells
from trocar.tools.monitor.events import UNDER_WAY, EventRow, commands_of, events_of, under_way
from trocar.tools.monitor.overview import Overview, overview
from trocar.tools.monitor.processes import ProcessesData
from trocar.tools.monitor.topics import TopicsData
from trocar.tools.monitor.values import open_values
from trocar.tools.output.printing import number, span, table, tell

WINDOW_S = 0.4
"""Window for rates and shares of a core."""
EVENTS, COMMANDS = 200, 100
EVENTS_SHOWN, COMMANDS_SHOWN = 8, 8


@dataclasses.dataclass(frozen=True, slots=True)
class Sight:
    """The current data; `values`: of each record its fields by name, of an event ring nothing."""

    overview: Overview
    processes: list[Any]
    topics: list[Any]
    values: dict[str, Any]
    events: list[Any]
    under_way: list[Any]
    commands: list[Any]


def snapshot(system: str) -> Sight:
    """Look at everything once; takes as long as the rates need."""
    processes = ProcessesData()
    with closing(TopicsData(system)) as topics, closing(events_of(system)) as events, \
            closing(commands_of(system)) as asked:
        processes.rows(overview(system).processes)
        topics.rows()
        pause(WINDOW_S)
        found = overview(system)
        rows = asked.rows()
        return Sight(found, processes.rows(found.processes), topics.rows(found.silences), _values(system, topics),
                        events.rows()[-EVENTS:], under_way(rows, found.processes), rows[-COMMANDS:])


def _values(system: str, topics: TopicsData) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for entry in topics.entries:
        if entry.kind == RECORD and entry.ring not in ("events", "audit"):
            opened = open_values(system, entry)
            if isinstance(opened, str):
                found[entry.name] = {"problem": opened}
            else:
                found[entry.name] = opened.newest()
                opened.close()
    return found


def document(system: str) -> dict[str, Any]:
    """As one JSON document; unknown values, and those that are not numbers, are null."""
    shot = snapshot(system)
    seen = shot.overview
    return {
        "system": system, "monotonic_ns": monotonic_ns(), "supervisor": seen.supervisor, "dead_s": seen.dead_s,
        "clock": seen.clock, "calibration_mode": seen.calibrating, "first": seen.first.removeprefix("first: "),
        "processes": [{**dataclasses.asdict(row.status), "cpu_percent": row.cpu_percent, "memory_mb": row.memory_mb}
                      for row in shot.processes],
        "standings": [dataclasses.asdict(one) for one in seen.standings],
        "topics": [{**dataclasses.asdict(row), "is_old": row.is_old} for row in shot.topics],
        "values": shot.values,
        "events": [{"from": row.who, **row.data} for row in shot.events],
        "under_way": [dataclasses.asdict(row) for row in shot.under_way],
        "commands": [dataclasses.asdict(row) for row in shot.commands],
    }


def print_once(system: str) -> None:
    """All of a system."""
    shot = snapshot(system)
    seen = shot.overview
    rates = [(row.name, number(row.nominal_hz, "g") if row.nominal_hz else "on events", number(row.hz, ".1f"),
              number(row.max_ms, ".2f"), span(row.age_s), row.problem) for row in shot.topics]
    asked = [tuple(dataclasses.replace(row, outcome=UNDER_WAY).cells) for row in reversed(shot.under_way)]
    asked += [tuple(row.cells) for row in list(reversed(shot.commands))[:COMMANDS_SHOWN]]
    table(f"system {seen.system}, {seen.words}, clock {seen.clock}", standing.COLUMNS,
          [standing.cells(one) for one in seen.standings])
    for line in filter(None, (seen.remark, seen.first)):
        tell(line)
    table("events, newest first", ("at", "from", "event", "text"),
          [(row.at, row.who, row.what, row.text) for row in _once_each(shot.events)])
    table("", (*COLUMNS[:-1], "CPU %", "MB", COLUMNS[-1]),
          [(*cells(row.status)[:-1], number(row.cpu_percent), number(row.memory_mb, ".0f"), row.status.problem)
           for row in shot.processes], (*RIGHT, "CPU %", "MB"))
    table("topics", ("topic", "nominal", "Hz", "longest ms", "age", "problem"), rates,
          ("nominal", "Hz", "longest ms", "age"))
    table("commands, newest first", ("at", "asked", "for", "outcome", "whose", "reason"), asked)


def _once_each(events: list[EventRow]) -> list[EventRow]:
    """The newest events, the newest first; repeated reports appear once."""
    newest = {(row.who, row.what, row.text): row for row in events}
    return sorted(newest.values(), key=lambda row: row.order, reverse=True)[:EVENTS_SHOWN]
