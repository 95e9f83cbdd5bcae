"""`trocar logs [NAME]`: what the processes wrote to their output, in the order in which they wrote it."""

from __future__ import annotations

import contextlib
import itertools
import os
from collections import deque
from collections.abc import Container, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, TextIO

import typer

from trocar.procs.document.process import processes_of
from trocar.procs.machine.log_files import is_old
from trocar.procs.machine.paths import is_folder, log_folder
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.shm.system.events import STATUS
from trocar.shm.system.loglines import LogLine, is_about, parsed
from trocar.shm.time.clock import pause
from trocar.tools.analysis.as_system import RecordingOption
from trocar.tools.analysis.choosing import opened
from trocar.tools.inspect.messages import asked_line, asked_rows
from trocar.tools.inspect.messages import line as event_line
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import answer, emit, need_reader, note, tell
from trocar.tools.systems.find import chosen_or_earlier, chosen_system, unknown
from trocar.tools.verbs.options import JsonOption, SystemOption

POLL_S = 0.1
MAX_LINES = 100
"""Of an entry at most, the newest ones: what a process prints has no stamps, and may be long."""


def logs(
    instance: Annotated[str | None, typer.Argument(metavar="[NAME]", help="One process; default: all.")] = None,
    lines: Annotated[int, typer.Option("-n", "--lines", min=0, help="Newest entries.")] = 20,
    commands: Annotated[bool, typer.Option("--commands", help="Commands instead, with sender and outcome; of a running "
                                           "system, or of a recording.")] = False,
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Follow new entries.")] = False,
    as_json: JsonOption = False,
    recording: RecordingOption = None,
    system: SystemOption = None,
) -> int:
    """Print the newest log entries of the processes; with --system also for a system that is down.

    Entries of several processes come in the order in which they were written. A traceback counts as part of its entry.

    Example: trocar logs PSM1 -n 50

    Example: trocar logs PSM1 --commands

    For a recording: its newest messages, with the times of the recording, or with --commands the recorded commands.
    """
    if recording is not None or commands:
        for row, text in (_recorded(recording, instance, lines, commands) if recording is not None else
                          _asked(system or chosen_system(), instance, lines, as_json)):
            answer(row, text, as_json)
        return 0
    folder = log_folder(os.environ, system or chosen_or_earlier(f"logs {instance}" if instance else "logs"))
    if not is_folder(folder):
        chosen_system(system)  # who may not look at it, or misspells it, is told so
        raise Problem(f"{folder}: there are no logs of this system")
    with contextlib.suppress(KeyboardInterrupt):
        _print_files(folder, instance, lines, follow, as_json)
    return 0


def _print_files(folder: Path, instance: str | None, lines: int, follow: bool, as_json: bool) -> None:
    """The newest entries of a system's log files, and with `follow` those that come, until Ctrl-C."""
    found = {path.stem: path for path in sorted(folder.glob("*.log")) if not is_old(path)}
    writer = _host(folder.name, instance, found) if instance is not None else ""
    if instance is not None and writer not in found:
        raise unknown("log", instance, found)
    chosen = {writer: found[writer]} if writer else found
    only = instance if writer != instance else None
    with contextlib.ExitStack() as stack:
        files = {name: stack.enter_context(path.open(errors="replace")) for name, path in chosen.items()}
        shown, older = newest({name: _news(file, only) for name, file in files.items()}, lines)
        _tell_older(left_out(older, "lines", lines), as_json)
        while True:
            for name, line in shown:
                _print(name, line, len(chosen) > 1, as_json)
            if not follow:
                return
            need_reader()
            pause(POLL_S)
            shown = in_order({name: _news(file, only) for name, file in files.items()})


def _asked(system: str, instance: str | None, most: int, as_json: bool) -> Iterator[tuple[dict[str, Any], str]]:
    """The newest commands of a running system."""
    rows, older = asked_rows(system, instance, most)
    _tell_older(left_out(older, "commands", most), as_json)
    for row in rows:
        yield row, asked_line(row)


def _recorded(file: Path, instance: str | None, most: int, commands: bool) -> list[tuple[dict[str, Any], str]]:
    """The newest messages, or commands with what became of them, of all processes or one, oldest first: data and words.

    What the process `system` repeats of others is left out.
    """
    with opened(file) as recording:
        rows = recording.commands() if commands else recording.events()
        for problem in recording.problems:
            note(f"{file}: {problem}")
        kinds = {topic.instance: topic.kind for topic in recording.topics.values() if topic.kind}
    found = []
    for row in rows:
        name = row["instance"]
        if instance not in (None, name):
            continue
        data = {"process": name, **{key: value for key, value in row.items() if key not in ("instance", "sequence")}}
        if "values" in data:
            data["values"] = data["values"][: data.pop("count")]
        if commands:
            found.append((data, asked_line(data)))
        elif int(row["severity"]) >= STATUS and (kinds.get(name) != "system" or instance is not None):
            found.append((data, f"{name}  {event_line(data)}"))
    return found[-most:] if most else []


def _tell_older(text: str, as_json: bool) -> None:
    if text and not as_json:
        tell(text)


def _host(system: str, name: str, found: Container[str]) -> str:
    """Whose log has the lines of a process: its host's, where it has none of its own."""
    if name not in found:
        with contextlib.suppress(SegmentError, ValueError):
            return next((row.typed for row in processes_of(directory.document(system)) if row.name == name), name)
    return name


def _news(file: TextIO, only: str | None) -> list[str]:
    """What was written since, or of that what is about one name; a file that began anew is read from its beginning."""
    if file.tell() > os.fstat(file.fileno()).st_size:
        file.seek(0)
    lines = file.readlines()
    return lines if only is None else about(lines, only)


def about(lines: Sequence[str], name: str) -> list[str]:
    """The entries of one of several that write to the same file."""
    found: list[str] = []
    is_wanted = False
    for text in lines:
        line = parsed(text)
        is_wanted = is_about(line.text, name) if line.local else is_wanted
        found += [text] if is_wanted else []
    return found


def newest(files: Mapping[str, Sequence[str]], most: int) -> tuple[list[tuple[str, LogLine]], int]:
    """The newest `most` entries of several processes as they were written, and how many lines were left out."""
    found = [(entry[0].monotonic_s, name, entry) for name, lines in files.items() for entry in _last(lines, most)]
    found.sort(key=lambda row: row[0])
    shown = [(name, line) for _, name, entry in found[len(found) - min(most, len(found)):] for line in entry]
    return shown, sum(map(len, files.values())) - len(shown)


def _last(lines: Sequence[str], most: int) -> list[list[LogLine]]:
    """The newest entries of one process."""
    entries: list[list[LogLine]] = [[]]
    for line in map(parsed, itertools.islice(reversed(lines), MAX_LINES * most)):
        if len(entries) > most:
            break
        entries[-1].append(line)
        if line.local:
            entries.append([])
    return [entry[:MAX_LINES][::-1] for entry in reversed(entries[:most]) if entry]


def left_out(older: int, what: str, most: int) -> str:
    """What a person is told first of what is not shown; empty: that is all."""
    return f"… {older} older {what if older != 1 else what.removesuffix('s')}: -n {10 * most}" if older and most else ""


def in_order(lines: Mapping[str, Iterable[str]]) -> list[tuple[str, LogLine]]:
    """Lines of several processes by their stamps; one without goes with the line before it."""
    found: list[tuple[float, str, LogLine]] = []
    for name, each in lines.items():
        since_s = 0.0
        for line in map(parsed, each):
            since_s = line.monotonic_s or since_s
            found.append((since_s, name, line))
    found.sort(key=lambda row: row[0])
    return [(name, line) for _, name, line in found]


def _print(name: str, line: LogLine, several: bool, as_json: bool) -> None:
    if as_json:
        emit({"process": name, "local": line.local or None, "monotonic_s": line.monotonic_s or None,
              "level": line.level or None, "line": line.text})
    else:
        when = line.local[11:23]
        tell("  ".join(part for part in (when, name if several else "", line.level, line.text) if part), flush=True)


def tail(path: Path, lines: int) -> str:
    """The newest lines of a file without their stamps, empty when there is none."""
    if not path.exists():
        return ""
    with path.open(encoding="utf-8", errors="replace") as file:
        found = map(parsed, deque(file, maxlen=lines))
        return "\n".join(f"{line.level} {line.text}".lstrip() for line in found).rstrip()
