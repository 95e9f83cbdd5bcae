"""Everything that the monitor shows, as one document or as text: for programs, pipes and mails."""

from __future__ import annotations

import dataclasses
from typing import Any

from trocar.procs.crtk.topics import RECORD
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.monitor.commands import CommandsData, under_way
from trocar.tools.monitor.events import EventsData
from trocar.tools.monitor.overview import Overview, overview
from trocar.tools.monitor.processes import ProcessesData
from trocar.tools.monitor.topics import TopicsData
from trocar.tools.monitor.values import open_values

WINDOW_S = 0.4
"""Rates and shares of a core are of so long."""
EVENTS, COMMANDS = 200, 100


@dataclasses.dataclass(frozen=True, slots=True)
class Sight:
    """What there is now; `values`: of each record its fields by name, of an event ring nothing."""

    overview: Overview
    processes: list[Any]
    topics: list[Any]
    values: dict[str, Any]
    events: list[Any]
    under_way: list[Any]
    commands: list[Any]


def snapshot(system: str, window_s: float = WINDOW_S) -> Sight:
    """Look at everything once; takes as long as rates need."""
    topics, events, asked = TopicsData(system), EventsData(system), CommandsData(system)
    processes = ProcessesData()
    try:
        processes.rows(overview(system).processes)
        topics.rows()
        pause(window_s)
        found = overview(system)
        rows = asked.rows()
        return Sight(found, processes.rows(found.processes), topics.rows(found.silences), _values(system, topics),
                        events.rows()[-EVENTS:], under_way(rows, found.processes), rows[-COMMANDS:])
    finally:
        for part in (topics, events, asked):
            part.close()


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
    """As JSON knows it: one document; what is not known, or not a number, is null."""
    shot = snapshot(system)
    seen = shot.overview
    return {
        "system": system, "monotonic_ns": monotonic_ns(), "supervisor": seen.supervisor, "dead_s": seen.dead_s,
        "clock": seen.clock, "first": seen.first.removeprefix("first: "),
        "processes": [{**dataclasses.asdict(row.status), "cpu_percent": row.cpu_percent, "memory_mb": row.memory_mb}
                      for row in shot.processes],
        "standings": [dataclasses.asdict(one) for one in seen.standings],
        "topics": [{**dataclasses.asdict(row), "is_old": row.is_old} for row in shot.topics],
        "values": shot.values,
        "events": [{"from": row.who, **row.data} for row in shot.events],
        "under_way": [dataclasses.asdict(row) for row in shot.under_way],
        "commands": [dataclasses.asdict(row) for row in shot.commands],
    }
