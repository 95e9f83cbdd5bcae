"""`trocar logs [NAME]`: what the processes wrote to their output."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, TextIO

import typer

from procs.lib.paths import log_folder
from shm.clock import pause
from tools.asked import in_words, rows_of
from tools.errors import Problem
from tools.options import JsonOption, SystemOption
from tools.printing import emit
from tools.systems import chosen_system, unknown

POLL_S = 0.1


def logs(
    instance: Annotated[str | None, typer.Argument(metavar="[NAME]", help="One process; none: all of them.")] = None,
    lines: Annotated[int, typer.Option("-n", "--lines", min=0, help="Newest lines of each.")] = 20,
    commands: Annotated[bool, typer.Option("--commands", help="Instead: what was asked for, by whom, and what became "
                                           "of it; while the system runs.")] = False,
    follow: Annotated[bool, typer.Option("--follow", "-f", help="Go on with what comes.")] = False,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Print the newest lines the processes wrote; also after the system went down (then with --system).

    Example: trocar logs PSM1 -n 50

    Example: trocar logs PSM1 --commands
    """
    if commands:
        for row in rows_of(system or chosen_system(), instance, lines):
            emit(row) if as_json else print(in_words(row))
        return 0
    folder = log_folder(os.environ, system or chosen_system())
    if not _is_folder(folder):
        chosen_system(system)  # who may not look at it, or misspells it, is told so
        raise Problem(f"{folder}: there are no logs of this system")
    found = {path.stem: path for path in sorted(folder.glob("*.log")) if not path.stem.endswith(".previous")}
    if instance is not None and instance not in found:
        raise unknown("log", instance, found)
    chosen = {instance: found[instance]} if instance is not None else found
    files = {name: path.open(errors="replace") for name, path in chosen.items()}
    try:
        for name, file in files.items():
            for line in deque(file, maxlen=lines):
                _print(name, line, len(chosen) > 1, as_json)
        while follow:
            _follow(files, len(chosen) > 1, as_json)
            pause(POLL_S)
    except KeyboardInterrupt:
        return 0
    finally:
        for file in files.values():
            file.close()
    return 0


def _is_folder(path: Path) -> bool:
    try:
        return path.is_dir()
    except OSError:  # it may not even be asked about
        return False


def _follow(files: Mapping[str, TextIO], several: bool, as_json: bool) -> None:
    for name, file in files.items():
        for line in file:
            _print(name, line, several, as_json)


def _print(name: str, line: str, several: bool, as_json: bool) -> None:
    if as_json:
        emit({"process": name, "line": line.rstrip("\n")})
    else:
        print(f"{name}: {line.rstrip()}" if several else line.rstrip(), flush=True)


def tail(path: Path, lines: int) -> str:
    """The newest lines of a file, empty when there is none."""
    if not path.exists():
        return ""
    with path.open(errors="replace") as file:
        return "".join(deque(file, maxlen=lines)).rstrip()
