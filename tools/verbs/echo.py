"""`trocar echo TOPIC`: what a topic, or a field of it, says."""

from __future__ import annotations

import contextlib
import dataclasses
import math
from collections.abc import Callable, Iterator
from typing import Annotated, Any

import typer

from trocar.procs.crtk.demand import Wanted, wait_until_computed
from trocar.procs.crtk.field_paths import BadPath, FieldCells, FieldPath, all_cells, cells_of
from trocar.procs.crtk.topics import EVENT, RECORD, find
from trocar.procs.crtk.views import OpenTopic, event_as_dict, state_as_event
from trocar.shm.memory.segment import SegmentError
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.control_page import silence_s
from trocar.tools.inspect.enumerations import in_words
from trocar.tools.inspect.messages import line
from trocar.tools.output.columns import columns_file, path_of, shaped, values_of
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.output.printing import emit, need_reader, note, span, table, tell, width
from trocar.tools.output.tables import wrapped
from trocar.tools.systems.find import chosen_system
from trocar.tools.verbs.options import JsonOption, SystemOption

POLL_S = 0.005
FIRST_S = 2.0  # to wait for the first record, and with --count for each one
COMPUTED_S = 0.2  # to wait for values on demand
HISTORY = 100  # events shown of those from before


def echo(
    topic: Annotated[str, typer.Argument(
        metavar="TOPIC", help="INSTANCE/NAME, as in trocar list, or a field: PSM1/state.position[0].")],
    once: Annotated[bool, typer.Option("--once", help="Print the newest record and exit.")] = False,
    count: Annotated[int, typer.Option("-n", "--count", min=0, help="Exit after this many; 0: never.")] = 0,
    rate: Annotated[float, typer.Option("--rate", min=0.0, help="Records a second at most; 0: every record.")] = 10.0,
    timeout: Annotated[float | None, typer.Option(
        "--timeout", min=0.0, help="Exit after this many seconds without a record.")] = None,
    csv: Annotated[str, typer.Option(
        "--csv", metavar="FILE", help="Write CSV, one row per record; -: standard output.")] = "",
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Print the values of a topic.

    A topic is a whole record (PSM1/state), a CRTK name such as PSM1/measured_js, a field of either, or the events of a
    process: PSM1/events has all of them, PSM1/error, PSM1/warning and PSM1/status one kind each. Events are printed
    oldest first, each as one line with the time of day; then it waits for new ones. Fields that are computed on demand
    are requested while this runs. An unavailable value is printed as an empty field, in JSON as null. Exit code 1:
    nothing came in time.

    Example: trocar echo PSM1/measured_js --once --json

    Example: trocar echo PSM1/status -n 1

    Example: trocar echo 'PSM1/measured_js.position[0:3]' --csv - -n 5
    """
    if once and count:
        raise Misuse("cannot combine --once and --count")
    if csv and as_json:
        raise Misuse("cannot combine --csv and --json")
    path = path_of(topic)
    name, most = chosen_system(system), 1 if once else count
    source = _open(name, path)
    with source, Wanted(name, every=rate == 0.0) as demand, contextlib.suppress(KeyboardInterrupt):
        try:
            demand.want(source.entry)
        except SegmentError as error:
            note(f"{topic}: what is computed on demand may be missing ({error})")
        if source.entry.ring == "events" and not path.field and not csv:
            return _events(name, source, most, timeout, as_json)
        limit_s = FIRST_S if timeout is None else timeout
        _first(source, limit_s)
        with _showing(source, path, csv, as_json) as show:
            for shown, _ in enumerate(_records(source, most, rate, timeout), 1):
                show()
                if shown == most:
                    break
    return 0


def _open(system: str, path: FieldPath) -> OpenTopic:
    """The topic; of its fields only the one wanted, so that no other is computed for us."""
    entry = find(system, path.topic)
    if not path.field:
        return OpenTopic(system, entry)
    if entry.kind == EVENT:
        raise Misuse(f"{path.text}: an event has no fields; use {entry.instance}/events.{path.field}")
    with OpenTopic(system, entry) as source:
        source.newest()
        field = _cells(source, path).field
    return OpenTopic(system, dataclasses.replace(entry, fields=(field,) if field in entry.fields else ()))


def _cells(source: OpenTopic, path: FieldPath) -> FieldCells:
    try:
        return cells_of(source.entry, path, source.record)
    except BadPath as error:
        raise Misuse(str(error)) from None


@contextlib.contextmanager
def _showing(source: OpenTopic, path: FieldPath, csv: str, as_json: bool) -> Iterator[Callable[[], None]]:
    """What shows the record last read, in the way that was asked for."""
    cells = [_cells(source, path)] if path.field else []
    if csv:
        entry = source.entry if source.entry.kind != EVENT else dataclasses.replace(source.entry, kind=RECORD)
        cells = cells or all_cells(entry, source.record)
        labels = [label for each in cells for label in each.labels]
        with columns_file(csv, ["stamp_ns", "sequence", *labels]) as file:
            yield lambda: file.row([source.stamp_ns, source.sequence, *values_of(cells, source.record)])
    elif cells:
        yield lambda: _show_field(source, path, cells[0], as_json)
    else:
        yield lambda: _show(source, source.as_dict(), as_json)


# events


def _events(system: str, source: OpenTopic, most: int, timeout: float | None, as_json: bool) -> int:
    """What is kept, the newest last, then what comes. Without `most` or `timeout` until Ctrl-C."""
    rows = source.kept(most or HISTORY)
    if not rows and source.entry.event == "operating_state":
        found = state_as_event(system, find(system, f"{source.entry.instance}/state"))
        rows = [found] if found is not None else []
    for row in rows:
        _report(source, row, as_json)
    if not rows:
        problem = source.problem()
        note(f"{source.entry.name}: nothing yet" + (f" ({problem})" if problem else ""))
    reported, last = len(rows), int(rows[-1]["sequence"]) if rows else 0
    limit_s = timeout if timeout is not None else (FIRST_S if most == 1 else math.inf)
    since_ns = monotonic_ns()
    while not most or reported < most:
        if source.next():
            if source.sequence > last:
                _report(source, source.as_row(), as_json)
                reported, since_ns = reported + 1, monotonic_ns()
        elif monotonic_ns() - since_ns >= limit_s * 1e9:
            return 0 if reported else 1
        else:
            need_reader()
            pause(POLL_S)
    return 0


def _report(source: OpenTopic, row: dict[str, Any], as_json: bool) -> None:
    if not as_json:
        tell(line(row), flush=True)
    elif source.entry.kind == RECORD:
        emit(row)
    else:
        emit(event_as_dict(source.entry.event, row))


# records


def _records(source: OpenTopic, most: int, rate: float, timeout: float | None) -> Iterator[None]:
    """The one that has been read, and each one after it once it is read."""
    limit_s = FIRST_S if timeout is None else timeout
    yield
    if timeout is None and not most:
        limit_s = math.inf
    seen, since_ns = source.sequence, monotonic_ns()
    while True:
        if source.entry.rate_hz == 0.0 or rate == 0.0:
            found = source.next() and source.sequence > seen
            pause(0.0 if found else POLL_S)
        else:
            pause(1.0 / rate)
            found = source.newest() and source.sequence != seen
        if found:
            seen, since_ns = source.sequence, monotonic_ns()
            yield
            continue
        need_reader()
        if monotonic_ns() - since_ns >= limit_s * 1e9:
            problem = _reported(source)
            raise Problem(f"{source.entry.name}: nothing new for {limit_s:g} s" + (f" ({problem})" if problem else ""))


def _first(source: OpenTopic, timeout: float) -> None:
    end = monotonic_ns() + round(timeout * 1e9)
    while not source.newest():
        if monotonic_ns() >= end:
            printed = source.problem()
            raise Problem(f"{source.entry.name}: {'no record is whole' if source.head else 'nothing yet'}"
                          + (f" ({printed})" if printed else ""))
        pause(POLL_S)
    wait_until_computed(source, min(COMPUTED_S, timeout))


def _reported(source: OpenTopic) -> str:
    """What is wrong with the ring, and what we missed of it."""
    lost = f"{source.lost} records were overwritten before they were read" if source.lost else ""
    return "; ".join(part for part in (source.problem(), lost) if part)


def _show_field(source: OpenTopic, path: FieldPath, cells: FieldCells, as_json: bool) -> None:
    problem, value = _reported(source), shaped(cells, values_of([cells], source.record))
    if as_json:
        emit({"stamp_ns": source.stamp_ns, "sequence": source.sequence, "field": path.text, "value": value,
              "unit": cells.field.unit} | ({"problem": problem} if problem else {}))
        return
    shown = _text(in_words(cells.field, value))
    unit = f"  {cells.field.unit}" if cells.field.unit and value is not None else ""
    text = f"{source.stamp_ns * 1e-9:.6f}  {shown}{unit}" + (f"  problem: {problem}" if problem else "")
    tell("\n".join(wrapped(text, width(), "    ")), flush=True)


def _show(source: OpenTopic, row: dict[str, Any], as_json: bool) -> None:
    problem = _reported(source)
    if as_json:
        emit(row | ({"problem": problem} if problem else {}))
        return
    fields = {field.name: field for field in source.entry.fields}
    parts = dict(source.entry.view.fields) if source.entry.view is not None else {}
    rows = []
    for key, value in row.items():
        if key not in ("stamp_ns", "sequence"):
            field = fields.get(parts.get(key, key))
            shown = _text(in_words(field, value) if field is not None else value)
            shown += f"; {source.why_invalid}" if key == "valid" and not value else ""
            rows.append((key, shown, field.unit if field is not None and value is not None else ""))
    title = f"{source.entry.name}  sequence {row['sequence']}  age {_age(source)}"
    table(title + (f"\nproblem: {problem}" if problem else ""), ("field", "value", "unit"), rows)


def _age(source: OpenTopic) -> str:
    """Age of the record; if its writer has ended, at least the time since the writer's last heartbeat.

    The system's time may have stopped since.
    """
    age_s = max(source.age_s, (silence_s(source.system, source.entry.instance) or 0.0) if source.problem() else 0.0)
    return f"{age_s * 1e3:.1f} ms" if age_s < 1.0 else span(age_s)


def _text(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.6g}"
    if isinstance(value, list):
        return ("\n" if value and isinstance(value[0], list) else " ").join(_text(item) for item in value)
    return str(value) or '""'
