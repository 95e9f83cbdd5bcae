"""`trocar logs [NAME]`: what the processes wrote to their output, in the order in which they wrote it."""

from __future__ import annotations

import contextlib
import os
from collections import deque
from collections.abc import Container
from pathlib import Path
from typing import Annotated, TextIO

import typer

from trocar.procs.document.process import processes_of
from trocar.procs.machine.log_files import is_old
from trocar.procs.machine.paths import is_folder, log_folder
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.shm.system.loglines import LogLine, parsed
from trocar.shm.time.clock import pause
from trocar.tools.analysis.as_system import RecordingOption
from trocar.tools.analysis.said import recorded_lines
from trocar.tools.inspect.asked import in_words, rows_of
from trocar.tools.inspect.log_entries import about, in_order, left_out, newest
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import emit, need_reader, tell
from trocar.tools.systems.find import all_up, chosen_system, unknown
from trocar.tools.verbs.options import JsonOption, SystemOption

POLL_S = 0.1
LAST = 3  # systems that are named where none is up


def logs(
    instance: Annotated[str | None, typer.Argument(metavar="[NAME]", help="One process; none: all of them.")] = None,
    lines: Annotated[int, typer.Option("-n", "--lines", min=0, help="Newest entries.")] = 20,
    commands: Annotated[bool, typer.Option("--commands", help="Instead: what was asked for, by whom, and what became "
                                           "of it; while the system runs.")] = False,
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Go on with what comes.")] = False,
    as_json: JsonOption = False,
    recording: RecordingOption = None,
    system: SystemOption = None,
) -> int:
    """Print the newest entries the processes wrote; also after the system went down (then with --system).

    Entries of several processes come in the order in which they were written. A traceback belongs to its entry.

    Example: trocar logs PSM1 -n 50

    Example: trocar logs PSM1 --commands

    Of a recording: its newest messages, from the clock of its time, or with --commands what was asked for.
    """
    if recording is not None:
        for said in recorded_lines(recording, instance, lines, commands):
            emit(said.row) if as_json else tell(said.text)
        return 0
    if commands:
        rows, older = rows_of(system or chosen_system(), instance, lines)
        _tell_older(left_out(older, "commands", lines), as_json)
        for row in rows:
            emit(row) if as_json else tell(in_words(row))
        return 0
    folder = log_folder(os.environ, system or _chosen(instance))
    if not is_folder(folder):
        chosen_system(system)  # who may not look at it, or misspells it, is told so
        raise Problem(f"{folder}: there are no logs of this system")
    found = {path.stem: path for path in sorted(folder.glob("*.log")) if not is_old(path)}
    writer = _host(folder.name, instance, found) if instance is not None else ""
    if instance is not None and writer not in found:
        raise unknown("log", instance, found)
    chosen = {writer: found[writer]} if writer else found
    only = instance if writer != instance else None
    files = {name: path.open(errors="replace") for name, path in chosen.items()}
    try:
        shown, older = newest({name: _news(file, only) for name, file in files.items()}, lines)
        _tell_older(left_out(older, "lines", lines), as_json)
        for name, line in shown:
            _print(name, line, len(chosen) > 1, as_json)
        while follow:
            for name, line in in_order({name: _news(file, only) for name, file in files.items()}):
                _print(name, line, len(chosen) > 1, as_json)
            need_reader()
            pause(POLL_S)
    except KeyboardInterrupt:
        return 0
    finally:
        for file in files.values():
            file.close()
    return 0


def _chosen(instance: str | None) -> str:
    """The system meant where none is named; Problem names those that were up last where none is."""
    kept = sorted(log_folder(os.environ, "any").parent.glob("*/supervisor.log"), key=_changed, reverse=True)
    if all_up() or not kept:
        return chosen_system()
    words = f"logs {instance}" if instance else "logs"
    raise Problem(f"no system is up; trocar {words} --system NAME prints the logs of an earlier one: "
                  f"{', '.join(path.parent.name for path in kept[:LAST])}")


def _changed(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except OSError:
        return 0.0


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
    with path.open(errors="replace") as file:
        newest = map(parsed, deque(file, maxlen=lines))
        return "\n".join(f"{line.level} {line.text}".lstrip() for line in newest).rstrip()
