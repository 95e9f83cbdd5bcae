"""`trocar scope FIELD…`: fields at full rate around the moment at which a condition begins to hold."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from shutil import get_terminal_size
from typing import Annotated

import typer

from trocar.procs.crtk.field_paths import BadPath, FieldPath, parse_path
from trocar.procs.recordings.reading import RecordedTopic
from trocar.shm.time.clock import local_ns, monotonic_ns
from trocar.tools.analysis.as_system import LookedAt, RecordingOption, system_or_recording
from trocar.tools.analysis.choosing import FromOption, ToOption
from trocar.tools.inspect.messages import time_of_day
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.output.printing import emit, note, progress, tell
from trocar.tools.scope.capture import Capture, Capturing
from trocar.tools.scope.grammar import BadCondition, parse_condition
from trocar.tools.systems.find import chosen_system, is_simulated
from trocar.tools.verbs.options import JsonOption, SystemOption

MAX_S = 60.0
LAST_S, BEFORE_S, AFTER_S = 1.0, 0.5, 0.5
MIN_WIDTH, MAX_WIDTH = 40, 160


def scope(
    fields: Annotated[list[str], typer.Argument(metavar="FIELD…", help="E.g. PSM1/measured_js.velocity[0] or [0:3].")],
    when: Annotated[str, typer.Option("--when", metavar="CONDITION", help="Trigger; default: capture now.")] = "",
    before: Annotated[float | None, typer.Option(
        "--before", min=0.0, max=MAX_S, help="Seconds before the event (0.5); without --when, the last seconds (1).")
        ] = None,
    after: Annotated[float | None, typer.Option(
        "--after", min=0.0, max=MAX_S, help="Seconds after the event (0.5).")] = None,
    timeout: Annotated[float | None, typer.Option(
        "--timeout", min=0.0, help="Exit code 1 if it does not happen within this many seconds of real time.")] = None,
    past: Annotated[bool, typer.Option(
        "--past", help="Show its last occurrence in the rings; after a crash, always.")] = False,
    csv: Annotated[str, typer.Option("--csv", metavar="FILE", help="Every record as CSV; -: standard output.")] = "",
    png: Annotated[str, typer.Option("--png", metavar="FILE", help="A PNG plot; needs matplotlib.")] = "",
    height: Annotated[int, typer.Option("--height", min=3, max=40, help="Lines per plot on the terminal.")] = 6,
    as_json: JsonOption = False,
    recording: RecordingOption = None,
    begin: FromOption = 0.0,
    end: ToOption = None,
    system: SystemOption = None,
) -> int:
    """Show fields at full rate around a moment, like an oscilloscope: from the rings, every record once.

    A condition: FIELD > 0.5 (>= < <= == !=, also == FAULT or another word), abs(FIELD) > 0.5, event [NAME] [severity,
    code or "part of the text"], fault [NAME]; with and, or, not and brackets. Of several numbers: any of them. Without
    --when it takes the last second at once. Rings keep 3 s; more is kept from now on. A dead system's rings can be
    looked at, too, and recordings. What is computed on demand is wanted while this runs. Exit code 1: it did not
    happen.

    Example: trocar scope 'PSM1/measured_js.velocity[0:3]' --before 2

    Example: trocar scope 'PSM1/measured_js.position[0]' --when 'event PSM1' --past --csv -
    """
    if csv == "-" and as_json:
        raise Misuse("--csv - and --json say different things: both are for the output")
    if not when and (past or after is not None or timeout is not None):
        raise Misuse("--past, --after and --timeout belong to --when")
    if recording is None and (begin or end is not None):
        raise Misuse("--from and --to belong to --recording")
    try:
        paths = [parse_path(text) for text in fields]
        condition = parse_condition(when) if when else None
    except (BadPath, BadCondition) as error:
        raise Misuse(str(error)) from None
    before_s = before if before is not None else LAST_S if condition is None else BEFORE_S
    after_s = 0.0 if condition is None else AFTER_S if after is None else after
    part = LookedAt(begin, end)
    with (system_or_recording(chosen_system, system, recording, _needed_by(paths), part) as name,
          Capturing(name, paths, condition) as capturing):
        if condition is None:
            found: Capture | None = capturing.last(before_s)
        elif past or not capturing.is_up:
            found = capturing.past(before_s, after_s)
        else:
            found = _waited(capturing, when, before_s, after_s, timeout)
        if found is None:
            where = f"in what {recording or 'the rings'} kept" if timeout is None else f"within {timeout:g} s"
            note(f"{when}: did not happen {where}")
            return 1
        _show(name, found, when, (before_s, after_s), csv, png, as_json, height)
    return 0


def _needed_by(paths: Sequence[FieldPath]) -> Callable[[RecordedTopic], bool]:
    """Of a recording only this is read: rings of who is named, and all events."""
    named = {path.topic.partition("/")[0] for path in paths}
    return lambda topic: topic.ring == "events" or topic.instance in named


def _waited(capturing: Capturing, when: str, before_s: float, after_s: float, timeout: float | None) -> Capture | None:
    try:
        with progress(f"waiting for {when}") as say:
            say(f"waiting for {when}; Ctrl-C ends it", None)
            return capturing.wait(before_s, after_s, timeout)
    except KeyboardInterrupt:
        raise Problem(f"{when}: did not happen before Ctrl-C") from None


def _show(system: str, found: Capture, when: str, window_s: tuple[float, float], csv: str, png: str, as_json: bool,
          height: int) -> None:
    from trocar.tools.scope import output

    title = _title(system, found, when)
    if csv:
        output.write_csv(found, csv)
    if png:
        output.write_png(found, png, title)
    if as_json:
        emit(output.as_json(found, when, *window_s))
    if csv or png or as_json:
        for line in output.remarks(found):
            note(line)
        return
    width = min(MAX_WIDTH, max(MIN_WIDTH, get_terminal_size().columns)) if sys.stdout.isatty() else 80
    tell(title)
    for line in output.text_lines(found, -window_s[0], window_s[1], width, height):
        tell(line)
    for line in output.remarks(found):
        tell(line)


def _title(system: str, found: Capture, when: str) -> str:
    at_s = f"{found.moment_ns * 1e-9:.6f} s of its clock"
    if not is_simulated(system):
        at_s = f"{time_of_day(local_ns() - (monotonic_ns() - found.moment_ns))} ({at_s})"
    return f"system {system}: {when or 'the newest record'} at {at_s}"
