"""`trocar echo TOPIC`: what a topic says."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

import typer

from shm.clock import monotonic_ns, pause
from tools.errors import Misuse, Problem
from tools.options import JsonOption, SystemOption
from tools.printing import emit
from tools.systems import chosen_system
from tools.topics import EVENT
from tools.views import Source, open_topic, state_as_event

POLL_S = 0.005


def echo(
    topic: Annotated[str, typer.Argument(help="INSTANCE/NAME, as in trocar list.")],
    once: Annotated[bool, typer.Option("--once", help="Print the newest and leave.")] = False,
    count: Annotated[int, typer.Option("-n", "--count", min=0, help="Leave after so many; 0: go on.")] = 0,
    rate: Annotated[float, typer.Option("--rate", min=0.0, help="At most so many a second; 0: every record.")] = 10.0,
    timeout: Annotated[float, typer.Option("--timeout", min=0.0, help="Seconds to wait for the first one.")] = 2.0,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Print the values of a topic: a whole record, a CRTK view or an event with its history.

    Example: trocar echo PSM1/measured_js --once --json
    """
    if once and count:
        raise Misuse("--once and --count say different things")
    name = chosen_system(system)
    with open_topic(name, topic) as source:
        try:
            for shown, row in enumerate(_rows(name, source, once, rate, timeout), 1):
                _show(source, row, as_json, _said(source))
                if once or shown == count:
                    break
        except KeyboardInterrupt:
            return 0
    return 0


def _rows(system: str, source: Source, once: bool, rate: float, timeout: float) -> Iterator[dict[str, Any]]:
    yield _first(system, source, timeout)
    is_event = source.entry.kind == EVENT or source.entry.rate_hz == 0.0
    seen = source.sequence
    while not once:
        if is_event or rate == 0.0:
            while source.next():
                if source.sequence > seen:
                    yield source.as_dict()
            pause(POLL_S)
        else:
            pause(1.0 / rate)
            if source.newest() and source.sequence != seen:
                seen = source.sequence
                yield source.as_dict()


def _first(system: str, source: Source, timeout: float) -> dict[str, Any]:
    end = monotonic_ns() + round(timeout * 1e9)
    while True:
        if source.newest():
            return source.as_dict()
        if source.entry.event == "operating_state":
            found = state_as_event(system, source.entry.instance)
            if found is not None:
                return found
        if monotonic_ns() >= end:
            said = source.trouble()
            raise Problem(f"{source.entry.name}: {'no record is whole' if source.head else 'nothing was written yet'}"
                          + (f" ({said})" if said else ""))
        pause(POLL_S)


def _said(source: Source) -> str:
    """What is wrong with the ring, and what we missed of it."""
    lost = f"{source.lost} records were overwritten before they were read" if source.lost else ""
    return "; ".join(part for part in (source.trouble(), lost) if part)


def _show(source: Source, row: dict[str, Any], as_json: bool, trouble: str) -> None:
    if as_json:
        emit(row | ({"trouble": trouble} if trouble else {}))
        return
    units = {field.name: field.unit for field in source.entry.fields}
    parts = dict(source.entry.view.fields) if source.entry.view is not None else {}
    print(f"{source.entry.name}  sequence {row['sequence']}  age {source.age_s * 1e3:.1f} ms")
    if trouble:
        print(f"  trouble: {trouble}")
    for key, value in row.items():
        if key not in ("stamp_ns", "sequence"):
            unit = units.get(parts.get(key, key), "")
            print(f"  {key:<22} {_text(value)}" + (f"  {unit}" if unit and value is not None else ""))


def _text(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list):
        if value and isinstance(value[0], list):
            return "\n".join(["", *(" " * 4 + _text(row) for row in value)])
        return " ".join(_text(item) for item in value)
    return str(value)
