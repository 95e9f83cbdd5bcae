"""`trocar scope FIELD…`: fields at full rate around the moment at which a condition begins to hold."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
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
BEFORE_S = AFTER_S = 0.5
MIN_WIDTH, MAX_WIDTH = 40, 160


def scope(
    fields: Annotated[list[str], typer.Argument(
        metavar="FIELD…", help="Field of a topic, e.g. PSM1/measured_js.velocity[0] or …velocity[0:3].")],
    when: Annotated[str, typer.Option(
        "--when", metavar="CONDITION", help="Condition that triggers the plot; default: plot now.")] = "",
    before: Annotated[float | None, typer.Option(
        "--before", min=0.0, max=MAX_S,
        help="Seconds before the trigger or, without --when, before now; default: 0.5.")] = None,
    after: Annotated[float | None, typer.Option(
        "--after", min=0.0, max=MAX_S, help="Seconds after the trigger; default: 0.5.")] = None,
    timeout: Annotated[float | None, typer.Option(
        "--timeout", min=0.0, help="Maximum wait for the trigger, in seconds of real time.")] = None,
    past: Annotated[bool, typer.Option(
        "--past", help="Search the stored data for the newest trigger; do not wait.")] = False,
    csv: Annotated[str, typer.Option(
        "--csv", metavar="FILE", help="CSV file for all records; `-`: standard output.")] = "",
    png: Annotated[str, typer.Option("--png", metavar="FILE", help="PNG file for the plot; needs matplotlib.")] = "",
    height: Annotated[int, typer.Option("--height", min=3, max=40, help="Height of each plot in lines of text.")] = 6,
    as_json: JsonOption = False,
    recording: RecordingOption = None,
    begin: FromOption = 0.0,
    end: ToOption = None,
    system: SystemOption = None,
) -> int:
    """Plot fields of topics at full rate, like an oscilloscope.

    Without --when, scope plots the last 0.5 s. With --when CONDITION, scope waits for the first new record that meets
    CONDITION, and plots the time around this trigger. Exit code 1: no trigger.

    CONDITION has one of four forms: `FIELD OP VALUE`, `abs(FIELD) OP VALUE`, `event NAME WHAT`, `fault NAME`. OP is one
    of > >= < <= == and !=. VALUE is a number, or a word such as FAULT. NAME is a process. WHAT is a severity, a code,
    or text in quotes. NAME and WHAT may be left out. Combine conditions with `and`, `or`, `not` and brackets. A FIELD
    with several elements triggers if any of them meets the condition.

    Shared memory holds the last 1.9 s, or the last 0.7 s if all arms are KINEMATIC. If --before is longer and the
    trigger comes soon after the start of scope, the plot shows less of the time before the trigger. Some fields are
    computed only on request. The plot of such a field begins when scope starts. With --recording, or after a crash,
    scope searches the stored data, as with --past.

    Example: trocar scope 'PSM1/measured_js.velocity[0:3]' --before 1

    Example: trocar scope 'PSM1/measured_js.position[0]' --when 'event PSM1' --past --csv -
    """
    options = ScopeOptions(when, before, after, timeout, past, csv, png, as_json, height)
    options.check()
    if recording is None and (begin or end is not None):
        raise Misuse("--from and --to need --recording")
    try:
        paths = [parse_path(text) for text in fields]
        condition = parse_condition(when) if when else None
    except (BadPath, BadCondition) as error:
        raise Misuse(str(error)) from None
    with (system_or_recording(chosen_system, system, recording, _needed_by(paths), LookedAt(begin, end)) as name,
          Capturing(name, paths, condition) as capturing):
        found = _captured(capturing, options)
        if found is None:
            where = f"in {recording or 'the data in memory'}" if timeout is None else f"within {timeout:g} s"
            note(f"{when}: did not happen {where}")
            return 1
        _show(name, found, options)
    return 0


@dataclass(frozen=True, slots=True)
class ScopeOptions:
    """The moment, the time around it, and how it is shown; see the help of the verb."""

    when: str
    before: float | None
    after: float | None
    timeout: float | None
    past: bool
    csv: str
    png: str
    as_json: bool
    height: int

    def check(self) -> None:
        """Misuse for options that exclude or need each other."""
        if self.csv == "-" and self.as_json:
            raise Misuse("cannot combine --csv - and --json: both write to standard output")
        if not self.when and (self.past or self.after is not None or self.timeout is not None):
            raise Misuse("--past, --after and --timeout need --when")

    @property
    def window_s(self) -> tuple[float, float]:
        """Seconds before and after the moment."""
        after_s = AFTER_S if self.after is None else self.after
        return BEFORE_S if self.before is None else self.before, after_s if self.when else 0.0


def _captured(capturing: Capturing, options: ScopeOptions) -> Capture | None:
    """The moment; None: it did not happen."""
    if not options.when:
        return capturing.last(options.window_s[0])
    if options.past or not capturing.is_up:
        return capturing.past(*options.window_s)
    try:
        with progress(f"waiting for {options.when}") as say:
            say(f"waiting for {options.when}; Ctrl-C ends it", None)
            return capturing.wait(*options.window_s, options.timeout)
    except KeyboardInterrupt:
        raise Problem(f"{options.when}: did not happen before Ctrl-C") from None


def _needed_by(paths: Sequence[FieldPath]) -> Callable[[RecordedTopic], bool]:
    """Of a recording only this is read: rings of who is named, and all events."""
    named = {path.topic.partition("/")[0] for path in paths}
    return lambda topic: topic.ring == "events" or topic.instance in named


def _show(system: str, found: Capture, options: ScopeOptions) -> None:
    from trocar.tools.scope import output

    title, window_s = _title(system, found, options.when), options.window_s
    if options.csv:
        output.write_csv(found, options.csv)
    if options.png:
        output.write_png(found, options.png, title)
    if options.as_json:
        emit(output.as_json(found, options.when, *window_s))
    if options.csv or options.png or options.as_json:
        for line in output.remarks(found):
            note(line)
        return
    width = min(MAX_WIDTH, max(MIN_WIDTH, get_terminal_size().columns)) if sys.stdout.isatty() else 80
    for line in (title, *output.text_lines(found, -window_s[0], window_s[1], width, options.height),
                 *output.remarks(found)):
        tell(line)


def _title(system: str, found: Capture, when: str) -> str:
    at_s = f"{found.moment_ns * 1e-9:.6f} s of its clock"
    if not is_simulated(system):
        at_s = f"{time_of_day(local_ns() - (monotonic_ns() - found.moment_ns))} ({at_s})"
    return f"system {system}: {when or 'the newest record'} at {at_s}"
