"""`trocar convert`: configuration files from before dVRK 2.4 to today's formats, told key by key."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from procs.lib.config import Checked, check_file
from procs.lib.config.problem import Problem
from procs.lib.config.source import unreadable
from procs.lib.convert import LOST, Converted, convert_file, to_json
from tools.errors import Misuse
from tools.options import JsonOption

FINE, WRONG = 0, 1


@dataclass(slots=True)
class Result:
    """One old file: what it became, which files were written, and what a check of those found."""

    file: Path
    converted: Converted
    written: list[Path]
    problems: list[Problem]
    checks: list[Checked]

    @property
    def ok(self) -> bool:
        """Nothing is wrong, nothing was lost, and what was written is fine."""
        found = [problem for check in self.checks for problem in check.problems]
        return self.converted.complete and not any(problem.severity == "error" for problem in (*self.problems, *found))


def convert(
    files: Annotated[list[Path], typer.Argument(help="IO and PID XML, .rob, console*.json, old arm files.")],
    to: Annotated[
        Path | None, typer.Option("--to", metavar="FOLDER", help="Write here, not beside the old file.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite files that are there.")] = False,
    path: Annotated[
        list[Path] | None, typer.Option("--path", help="The check also looks for named files here.")
    ] = None,
    as_json: JsonOption = False,
) -> int:
    """Convert old configuration files to dVRK 2.4: what changed unit, was assumed or dropped is told key by key.

    Example: trocar convert sawRobotIO1394-PSM1-28007.xml console-PSM1.json --to new
    """
    if to is not None and not to.is_dir():
        raise Misuse(f"--to {to}: no such folder")
    results = [_converted(file, to, force) for file in files]
    for result in results:  # when all are written: systems name the others
        result.checks = [check_file(new, search=(*(path or ()), result.file.parent)) for new in result.written]
    if as_json:
        print(json.dumps({"files": [_row(r) for r in results], "ok": all(r.ok for r in results)}, indent=2,
                         ensure_ascii=False))
    else:
        for result in results:
            _print(result)
    return FINE if all(result.ok for result in results) else WRONG


def _converted(file: Path, to: Path | None, force: bool) -> Result:
    try:
        wrong = unreadable(file)
        data = b"" if wrong else file.read_bytes()
    except OSError as bad:
        wrong = f"cannot be read: {bad.strerror or bad}", ""
    if wrong:
        problem = Problem(str(file), 0, "", "", *wrong)
        return Result(file, Converted("unknown", (), (), (problem,)), [], [problem], [])
    converted = convert_file(str(file), data)
    result = Result(file, converted, [], list(converted.problems), [])
    paths = [(to or file.parent) / output.name for output in converted.outputs]
    result.problems += [problem for path in paths for problem in _in_the_way(path, file, force)]
    if not result.problems:
        result.problems += _write(paths, converted, result.written)
    return result


def _in_the_way(path: Path, old: Path, force: bool) -> list[Problem]:
    if not path.exists():
        return []
    if path.samefile(old):
        return [Problem(str(path), 0, "", "", "is the old file: it is never overwritten", "--to another folder")]
    return [] if force else [Problem(str(path), 0, "", "", "is there already", "--force to overwrite, --to FOLDER")]


def _write(paths: Sequence[Path], converted: Converted, written: list[Path]) -> list[Problem]:
    for path, output in zip(paths, converted.outputs, strict=True):
        try:
            path.write_text(to_json(output.data), encoding="utf-8")
        except ValueError as bad:
            return [Problem(str(path), 0, "", "", f"cannot be written as JSON: {bad}", "finite numbers")]
        except OSError as bad:
            return [Problem(str(path), 0, "", "", f"cannot be written: {bad.strerror or bad}")]
        written.append(path)
    return []


def _print(result: Result) -> None:
    for change in result.converted.changes:
        print(change)
    for problem in result.problems:
        print(problem)
    for check in result.checks:
        for problem in check.problems:
            print(problem)
        errors = sum(problem.severity == "error" for problem in check.problems)
        verdict = f"{errors} error{'s' if errors > 1 else ''} left" if errors else "fine"
        print(f"{result.file}: wrote {check.path}: {check.kind} file, {verdict}")
    lost = sum(change.fate == LOST for change in result.converted.changes)
    if lost:
        print(f"{result.file}: {lost} key{'s' if lost > 1 else ''} could not be converted")
    if not result.written:
        print(f"{result.file}: nothing was written")


def _row(result: Result) -> dict[str, object]:
    return {
        "file": str(result.file),
        "kind": result.converted.kind,
        "ok": result.ok,
        "written": [
            {"file": str(check.path), "kind": check.kind, "problems": [dataclasses.asdict(p) for p in check.problems]}
            for check in result.checks
        ],
        "changes": [dataclasses.asdict(change) for change in result.converted.changes],
        "problems": [dataclasses.asdict(problem) for problem in result.problems],
    }
