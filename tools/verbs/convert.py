"""`trocar convert`: configuration files from before dVRK 2.4 to today's formats, told key by key."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

from trocar.procs.config.read.problem import ERROR, count
from trocar.tools.converters.converting import Conversion, Result
from trocar.tools.converters.report import DROPPED, LOST
from trocar.tools.output.printing import emit, tell
from trocar.tools.verbs.options import JsonOption, PathOption

FINE, WRONG = 0, 1
_WORDS = {"equal": "there already and equal", "left_out": "left out", "with_errors": "with errors left"}
_ALWAYS = ("written", "copied", "failed")


def convert(
    files: Annotated[list[Path], typer.Argument(
        metavar="FILES...", help="IO and PID XML, .rob, console*.json, old arm files; folders.")],
    to: Annotated[
        Path | None, typer.Option("--to", metavar="FOLDER", help="Folder for all results, also unchanged files.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite existing files that differ.")] = False,
    path: PathOption = None,
    as_json: JsonOption = False,
) -> int:
    """Convert old configuration files to dVRK 2.4, check the results, and report each key that was dropped, assumed or
    converted to another unit.

    Example: trocar convert my-site --to new
    """
    results = Conversion(files, to, force, path or ()).results()
    for result in results:
        emit(_row(result)) if as_json else _print(result)
    summary = Summary(results)
    if as_json:
        emit({"summary": summary.as_dict()})
    else:
        summary.tell()
    return FINE if all(result.ok for result in results) else WRONG


class Summary:
    """The outcome of all files, and the keys that were lost and dropped."""

    def __init__(self, results: list[Result]) -> None:
        self.results, self.counts = results, _counts(results)
        self.failed = [str(result.file) for result in results if _failed(result)]
        self.with_errors = [str(result.file) for result in results if _has_errors(result)]
        self.lost, self.dropped = (
            [change for result in results if not _failed(result) for change in result.converted.changes
             if change.outcome == outcome] for outcome in (LOST, DROPPED))

    def as_dict(self) -> dict[str, object]:
        """For programs."""
        return self.counts | {"failed_files": self.failed, "files_with_errors": self.with_errors,
                              "lost": list(map(dataclasses.asdict, self.lost)),
                              "dropped": list(map(dataclasses.asdict, self.dropped))}

    def tell(self) -> None:
        """For people."""
        if all(result.copies for result in self.results):
            tell("no file has an old format: none needs a change")
        if self.results:
            counted = ", ".join(f"{number} {_WORDS.get(what, what)}" for what, number in self.counts.items()
                                if number or what in _ALWAYS)
            tell(f"files: {counted}; keys lost: {len(self.lost)}, dropped: {len(self.dropped)}")
        for change in self.lost:
            tell(f"  {change}")
        for what, names in (("failed", self.failed), ("with errors left", self.with_errors)):
            if names:
                tell(f"{what}: {', '.join(names)}")


def _print(result: Result) -> None:
    for finding in (*(() if _failed(result) else result.converted.changes), *result.problems):
        tell(str(finding))
    for check in result.checks:
        errors = count(check.problems)
        for problem in check.problems:
            if problem.severity == ERROR or not result.copies:
                tell(str(problem))
        verdict = f"{errors} error{'s' if errors > 1 else ''} left" if errors else "fine"
        if result.had:
            verdict += f", which {result.file} has as well" if result.had == errors else f", {result.had} as before"
        what = "copied to" if result.copies else "wrote" if check.path in result.written else "equal to"
        tell(f"{result.file}: {what} {check.path}: {check.kind} file, {verdict}")
    if _failed(result):
        tell(f"{result.file}: nothing was written")


def _failed(result: Result) -> bool:
    return count(result.problems) > 0 and not result.written and not result.equal


def _has_errors(result: Result) -> bool:
    """Whether it was written, or was there, and errors are left in it."""
    return not _failed(result) and count([found for check in result.checks for found in check.problems]) > 0


def _counts(results: list[Result]) -> dict[str, int]:
    """What became of all files."""
    return {
        "written": sum(len(result.written) for result in results if not result.copies),
        "copied": sum(len(result.written) for result in results if result.copies),
        "equal": sum(len(result.equal) for result in results),
        "with_errors": sum(map(_has_errors, results)),
        "failed": sum(map(_failed, results)),
        "left_out": sum(result.left_out for result in results),
    }


def _row(result: Result) -> dict[str, object]:
    return {
        "file": str(result.file),
        "kind": result.converted.kind,
        "ok": result.ok,
        "written": [
            {"file": str(check.path), "kind": check.kind, "problems": [dataclasses.asdict(p) for p in check.problems]}
            for check in result.checks if check.path in result.written
        ],
        "copied": [str(path) for path in result.written if result.copies],
        "equal": [str(path) for path in result.equal],
        "changes": [dataclasses.asdict(change) for change in result.converted.changes],
        "problems": [dataclasses.asdict(problem) for problem in result.problems],
    }
