"""`trocar check FILE…`: validate configuration files without starting anything."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

from trocar.procs.config import Checked, check_file
from trocar.procs.config.read.problem import WARNING, count
from trocar.procs.machine.paths import is_folder
from trocar.tools.output.printing import emit, tell

FINE, WRONG = 0, 1
SUFFIXES = (".json", ".yaml")


def check(
    files: Sequence[Path], path: Sequence[Path] = (), boards: str | None = None, sets: Sequence[str] = ()
) -> tuple[Checked, ...]:
    """Every file with its kind and what was found; `path`, `boards`, `sets` as `trocar up` has them."""
    return tuple(check_file(file, search=path, boards=boards, sets=sets) for file in files)


def run(files: Sequence[Path], path: Sequence[Path], as_json: bool, boards: str | None = None,
        sets: Sequence[str] = ()) -> int:
    """Print what was found in `files` and return the exit code: 1 when there is an error, 0 otherwise."""
    results = check(files, path, boards, sets)
    for result in results:
        if as_json:
            emit(_row(result))
            continue
        for problem in result.problems:
            tell(str(problem))
        for note in result.notes:
            tell(f"{result.path}: note: {note}")
        tell(f"{result.path}: {result.kind} file, {_verdict(result)}")
        if is_folder(result.path):
            tell(f"name the files in it: trocar check {' '.join(_patterns(result.path))}")
    return WRONG if any(count(result.problems) for result in results) else FINE


def _patterns(folder: Path) -> list[str]:
    """What names the files of a folder in a shell."""
    return [f"{folder}/*{suffix}" for suffix in SUFFIXES if any(folder.glob(f"*{suffix}"))] or [f"{folder}/*.json"]


def _verdict(result: Checked) -> str:
    errors, warnings = count(result.problems), count(result.problems, WARNING)
    if not errors and not warnings:
        return "fine"
    words = [(errors, "error"), (warnings, "warning")]
    return ", ".join(f"{number} {word}{'s' if number != 1 else ''}" for number, word in words if number)


def _row(result: Checked) -> dict[str, object]:
    return {
        "file": str(result.path),
        "kind": result.kind,
        "ok": not count(result.problems),
        "problems": [dataclasses.asdict(problem) for problem in result.problems],
        "notes": list(result.notes),
    }
