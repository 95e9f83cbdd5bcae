"""`trocar convert`: configuration files from before dVRK 2.4 to today's formats, told key by key."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

from tools.converters import LOST
from tools.converters.converting import Conversion, Result
from tools.errors import Misuse
from tools.options import JsonOption
from tools.printing import emit, tell

FINE, WRONG = 0, 1


def convert(
    files: Annotated[list[Path], typer.Argument(
        metavar="FILES...", help="IO and PID XML, .rob, console*.json, old arm files; folders.")],
    to: Annotated[
        Path | None, typer.Option("--to", metavar="FOLDER", help="Write here, not beside the old file.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that are there.")] = False,
    path: Annotated[
        list[Path] | None, typer.Option("--path", help="The check also looks for named files here.")
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """Convert old configuration files to dVRK 2.4: what changed unit, was assumed or dropped is reported key by key.

    Example: trocar convert sawRobotIO1394-PSM1-28007.xml console-PSM1.json --to new
    """
    if to is not None and not to.is_dir():
        raise Misuse(f"--to {to}: no such folder")
    results = Conversion(files, to, force, path or ()).results()
    for result in results:
        emit(_row(result)) if as_json else _print(result)
    return FINE if all(result.ok for result in results) else WRONG


def _print(result: Result) -> None:
    for change in result.converted.changes:
        tell(str(change))
    for problem in result.problems:
        tell(str(problem))
    for check in result.checks:
        for problem in check.problems:
            tell(str(problem))
        errors = sum(problem.severity == "error" for problem in check.problems)
        verdict = f"{errors} error{'s' if errors > 1 else ''} left" if errors else "fine"
        what = f"wrote {check.path}" if check.path in result.written else f"{check.path} is there already and equal"
        tell(f"{result.file}: {what}: {check.kind} file, {verdict}")
    lost = sum(change.outcome == LOST for change in result.converted.changes)
    if lost:
        tell(f"{result.file}: {lost} key{'s' if lost > 1 else ''} could not be converted")
    if not result.written and not result.equal:
        tell(f"{result.file}: nothing was written")


def _row(result: Result) -> dict[str, object]:
    return {
        "file": str(result.file),
        "kind": result.converted.kind,
        "ok": result.ok,
        "written": [
            {"file": str(check.path), "kind": check.kind, "problems": [dataclasses.asdict(p) for p in check.problems]}
            for check in result.checks if check.path in result.written
        ],
        "equal": [str(path) for path in result.equal],
        "changes": [dataclasses.asdict(change) for change in result.converted.changes],
        "problems": [dataclasses.asdict(problem) for problem in result.problems],
    }
