"""`trocar check FILE…`: validate configuration files without starting anything."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path
from typing import Annotated

import typer

from trocar.procs.config import Checked, check_file
from trocar.procs.config.loading.kinds import MODELS, schema_of
from trocar.procs.config.read.problem import WARNING, count
from trocar.procs.machine.paths import is_folder
from trocar.tools.output.errors import Misuse
from trocar.tools.output.printing import emit, tell
from trocar.tools.verbs.options import JsonOption, PathOption, SetOption

FINE, WRONG = 0, 1
SUFFIXES = (".json", ".yaml")


def check(
    files: Annotated[list[Path] | None, typer.Argument(
        metavar="FILES...", help="System files, or any file that a system file names.")] = None,
    path: PathOption = None,
    boards: Annotated[str | None, typer.Option(
        "--boards", help="`emulated` or `real` boards; default: as in the files.")] = None,
    sets: SetOption = None,
    schema: Annotated[str, typer.Option(
        "--schema", metavar="KIND", help="Kind of file whose JSON Schema is printed: system, io, pid, psm, …")] = "",
    as_json: JsonOption = False,
) -> int:
    """Validate configuration files, without starting anything.

    Each mistake is reported with its file, line, key, value and the allowed values.

    Example: trocar check configs/systems/demo.yaml
    """
    if schema:
        if schema not in MODELS:
            raise Misuse(f"--schema {schema}: allowed are {', '.join(MODELS)}")
        tell(json.dumps(schema_of(schema), indent=2))
        return FINE
    if not files:
        raise Misuse("name the files to check")
    results = [check_file(file, search=path or (), boards=boards, sets=sets or ()) for file in files]
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
