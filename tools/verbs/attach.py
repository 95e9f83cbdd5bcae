"""`trocar attach`: a live table of processes and topics; q or Ctrl-C leaves."""

from __future__ import annotations

import contextlib
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator
from typing import Annotated, Any

import typer
from rich.console import Console, Group
from rich.live import Live
from rich.text import Text

from procs.crtk.topics import EVENT, RECORD, TopicEntry, catalogue
from procs.crtk.views import OpenTopic
from shm.segment import SegmentError
from tools.errors import Problem
from tools.inspect import standing
from tools.inspect.messages import kind_of, text_of, time_of_day
from tools.inspect.processes import COLUMNS, RIGHT, cells, statuses
from tools.options import SystemOption
from tools.printing import made_table, number
from tools.systems import chosen_system, is_up
from tools.verbs.listing import measured

WINDOW_S = 0.4
EVENTS_SHOWN = 6


def attach(
    once: Annotated[bool, typer.Option("--once", help="Print it once and leave.")] = False,
    system: SystemOption = None,
) -> int:
    """Watch a running system: processes, topics and the newest events. Changes nothing.

    Example: trocar attach
    """
    name = chosen_system(system)
    entries = catalogue(name)
    console = Console(highlight=False) if sys.stdout.isatty() else Console(highlight=False, width=240)
    if once:
        console.print(_page(name, entries))
        return 0
    with contextlib.suppress(KeyboardInterrupt), keys() as pressed, Live(console=console, screen=True) as live:
        while pressed() not in ("q", "Q"):
            if not is_up(name):
                raise Problem(f"system {name} went down")
            live.update(_page(name, entries), refresh=True)
    return 0


def _page(system: str, entries: list[TopicEntry]) -> Group:
    records = [entry for entry in entries if entry.kind == RECORD]
    rates = [(row["topic"], number(row["hz"], ".1f"), number(row["max_ms"], ".2f"), row["problem"])
             for row in measured(system, records, WINDOW_S)]
    processes = statuses(system)
    found = standing.standings(system, processes)
    first = standing.first_thing(processes, found)
    return Group(
        made_table(f"system {system} (q leaves)", standing.COLUMNS, [standing.cells(one) for one in found]),
        Text(f"first: {first}" if first else "all well"),
        made_table("events, newest first", ("at", "from", "event", "text"), _events(system, entries)),
        made_table("", COLUMNS, [cells(process) for process in processes], RIGHT),
        made_table("joints", ("arm", "busy", "rad, m"), list(_joints(system, entries))),
        made_table("topics", ("topic", "Hz", "longest ms", "problem"), rates, ("Hz", "longest ms")),
    )


def _joints(system: str, entries: list[TopicEntry]) -> Iterator[tuple[str, ...]]:
    for entry in entries:
        if entry.kind == EVENT and entry.event == "operating_state":
            with contextlib.suppress(Problem, SegmentError), contextlib.ExitStack() as stack:
                state = next((e for e in entries if e.name == f"{entry.instance}/state"), entry)
                joints = next((e for e in entries if e.name == f"{entry.instance}/measured_js"), None)
                source = stack.enter_context(OpenTopic(system, state))
                if joints is None or "sub_state" not in {f.name for f in state.fields} or not source.newest():
                    continue
                row = source.as_dict()
                view = stack.enter_context(OpenTopic(system, joints))
                good = view.newest() and view.valid
                values = " ".join(f"{q:+.4f}" for q in view.part("position")) if good else "–"
                yield entry.instance, _yes(row["is_busy"]), values


def _yes(flag: bool) -> str:
    return "yes" if flag else "no"


def _events(system: str, entries: list[TopicEntry]) -> list[tuple[str, ...]]:
    found: list[tuple[int, tuple[str, ...]]] = []
    for entry in entries:
        if entry.ring == "events" and entry.kind == RECORD:
            with contextlib.suppress(SegmentError), OpenTopic(system, entry) as source:
                found += [(int(row["monotonic_ns"]), _event(entry.instance, row))
                          for row in source.history(EVENTS_SHOWN)]
    reported: dict[tuple[str, ...], tuple[int, tuple[str, ...]]] = {}
    for stamp_ns, row in sorted(found, reverse=True):
        reported[row[2:]] = stamp_ns, row  # the system repeats what others tell: who was first is shown
    return [row for _, row in sorted(reported.values(), reverse=True)[:EVENTS_SHOWN]]


def _event(instance: str, row: dict[str, Any]) -> tuple[str, ...]:
    return time_of_day(int(row["local_ns"])), instance, kind_of(row), text_of({**row, "hint": ""})


@contextlib.contextmanager
def keys() -> Iterator[Callable[[], str]]:
    """`pressed()` gives the key that was pressed, or nothing; without a terminal nothing is ever pressed."""
    if not sys.stdin.isatty():
        yield lambda: ""
        return
    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)
    try:
        yield lambda: sys.stdin.read(1) if select.select([sys.stdin], [], [], 0.05)[0] else ""
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
