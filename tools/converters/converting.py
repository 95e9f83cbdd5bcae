"""One run of `trocar convert`: which files it takes, what it writes where, and whom references lead to afterwards."""

from __future__ import annotations

import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from procs.config import PROJECT_CONFIGS, Checked, check_file
from procs.config.read.problem import WARNING, FileProblem
from procs.config.read.search import search_path
from procs.config.read.source import read_source, unreadable
from tools.converters import OTHER, Converted, Reference, convert_file, differences, to_json, with_arm_file

SUFFIXES = (".xml", ".json", ".rob")
CONSOLE = "console"
SHOWN = 6  # differing values in a warning


@dataclass(slots=True)
class Result:
    """One old file: what it became, which files were written or there already, and what a check of those found."""

    file: Path
    converted: Converted
    written: list[Path] = field(default_factory=list)
    equal: list[Path] = field(default_factory=list)
    problems: list[FileProblem] = field(default_factory=list)
    checks: list[Checked] = field(default_factory=list)

    @property
    def ok(self) -> bool:
        """Nothing is wrong, nothing was lost, and what was written is fine."""
        found = [problem for check in self.checks for problem in check.problems]
        return self.converted.complete and not any(problem.severity == "error" for problem in (*self.problems, *found))


@dataclass(frozen=True, slots=True)
class Old:
    """A file to convert and the folder its new files come to; those found in a folder need not be old ones."""

    file: Path
    folder: Path
    found: bool


class Conversion:
    """All files of one call."""

    def __init__(self, files: Sequence[Path], to: Path | None, force: bool, path: Sequence[Path]) -> None:
        """`files` may be folders: everything in them, whose order of folders `to` gets as well."""
        self._force, self._path = force, tuple(path)
        self._olds = [old for file in files for old in _olds(file, to)]
        self._made: dict[Path, Path] = {}  # the first new file of every old one that is no console
        self._texts: dict[Path, tuple[str, Path]] = {}  # what this run has written, and from which old file

    def results(self) -> list[Result]:
        """Convert, write, then check: systems name the others."""
        first = [(old, self._read(old, follow=False)) for old in self._olds]
        for old, result in first:
            if result.converted.outputs and result.converted.kind != CONSOLE:
                self._made[old.file.resolve()] = old.folder / result.converted.outputs[0].name
        results = []
        for old, result in first:
            if old.found and result.converted.kind == OTHER:
                continue
            done = self._read(old, follow=True) if result.converted.kind == CONSOLE else result
            self._write(old, done)
            results.append(done)
        for result in results:
            self._check(result)
        return results

    def _read(self, old: Old, *, follow: bool) -> Result:
        file = old.file
        try:
            wrong = unreadable(file)
            data = b"" if wrong else file.read_bytes()
        except OSError as bad:
            wrong = f"cannot be read: {bad.strerror or bad}", ""
        if wrong:
            problem = FileProblem(str(file), 0, "", "", *wrong)
            return Result(file, Converted("unknown", (), (), (problem,)), problems=[problem])
        converted = convert_file(str(file), data, (lambda name: self._follow(old, name)) if follow else None)
        return Result(file, converted, problems=list(converted.problems))

    def _follow(self, old: Old, name: str) -> str:
        """The new name of a file that this run converts, as seen from the folder of the new system file."""
        for folder in (old.file.parent, *self._path):
            made = self._made.get((folder / name).resolve())
            if made is not None:
                return os.path.relpath(made, old.folder)
        return ""

    # -- writing -------------------------------------------------------------------------------------------------------

    def _write(self, old: Old, result: Result) -> None:
        """All new files of an old one, or none."""
        if result.problems:
            return
        self._name_apart(old, result)
        plan: list[tuple[Path, str]] = []
        for output in result.converted.outputs:
            path = old.folder / output.name
            try:
                text = to_json(output.data)
            except ValueError as bad:
                result.problems.append(FileProblem(str(path), 0, "", "", f"cannot be written as JSON: {bad}",
                                                   "finite numbers"))
                continue
            if self._is_equal(path, text):
                result.equal.append(path)
            else:
                result.problems += self._in_the_way(path, old.file)
                plan.append((path, text))
        if result.problems:
            result.equal.clear()
            return
        for path, text in plan:
            try:
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text, encoding="utf-8")
            except OSError as bad:
                result.problems.append(FileProblem(str(path), 0, "", "", f"cannot be written: {bad.strerror or bad}"))
                return
            self._texts[path] = text, old.file
            result.written.append(path)

    def _name_apart(self, old: Old, result: Result) -> None:
        """Another name for an arm file that two consoles make differently."""
        if result.converted.kind != CONSOLE:
            return
        system, *arms = result.converted.outputs
        for output in arms:
            path = old.folder / output.name
            if path in self._texts and self._texts[path][0] != to_json(output.data):
                new = f"{path.stem}-{Path(system.name).stem.removeprefix('system-')}.json"
                result.converted = with_arm_file(result.converted, str(old.file), output.name, new)

    def _is_equal(self, path: Path, text: str) -> bool:
        try:
            return path.is_file() and path.read_text(encoding="utf-8") == text
        except (OSError, UnicodeDecodeError):
            return False

    def _in_the_way(self, path: Path, old: Path) -> list[FileProblem]:
        if not path.exists():
            return []
        if path.samefile(old):
            return [FileProblem(str(path), 0, "", "", "is the old file: it is never overwritten",
                                "--to another folder")]
        if path in self._texts:
            text = f"this run has made another file of this name, from {self._texts[path][1]}"
            return [FileProblem(str(path), 0, "", "", text, "convert one of them --to another folder")]
        if self._force:
            return []
        return [FileProblem(str(path), 0, "", "", "is there already", "--force to overwrite, --to FOLDER")]

    # -- afterwards ----------------------------------------------------------------------------------------------------

    def _check(self, result: Result) -> None:
        search = (*self._path, result.file.parent)
        files = [*result.written, *result.equal]
        result.checks = [check_file(new, search=search) for new in files]
        if files and result.converted.kind == CONSOLE:
            result.problems += self._stock_in_place_of_own(files[0].parent, result)

    def _stock_in_place_of_own(self, folder: Path, result: Result) -> Iterable[FileProblem]:
        """What the site has a file of its own for, and gets a stock file for from now on: with the differing values."""
        folders = search_path((folder, *self._path, result.file.parent, PROJECT_CONFIGS))
        for reference in result.converted.references:
            own = next((folder / reference.old for folder in (result.file.parent, *self._path)
                        if (folder / reference.old).is_file()), None)
            stock = folders.find(reference.new)
            if reference.converted_with_it or own is None or stock is None or stock.samefile(own):
                continue
            changed = _changed(own, stock)
            if changed:
                yield _fallback(result.file, reference, own, stock, changed)


def _changed(own: Path, stock: Path) -> list[str]:
    converted = convert_file(str(own), own.read_bytes())
    source, _ = read_source(stock)
    if not converted.outputs or source is None:
        return []
    return differences(converted.outputs[0].data, source.data)


def _fallback(console: Path, reference: Reference, own: Path, stock: Path, changed: list[str]) -> FileProblem:
    more = f"; and {len(changed) - SHOWN} more" if len(changed) > SHOWN else ""
    text = f"{stock} is read in the place of {own}, {len(changed)} values differ: {'; '.join(changed[:SHOWN])}{more}"
    allowed = f"convert {own.name} in the same run, and name what it becomes in the system file"
    return FileProblem(str(console), reference.line, reference.key, reference.old, text, allowed, WARNING)


def _olds(file: Path, to: Path | None) -> list[Old]:
    """A file by itself, or those of a folder that may be old ones, but for what an earlier run wrote to `to`."""
    if not file.is_dir():
        return [Old(file, to or file.parent, found=False)]
    inside = sorted(path for path in file.rglob("*") if path.suffix.lower() in SUFFIXES and path.is_file())
    new = to.resolve() if to is not None and to.resolve() != file.resolve() else None
    return [Old(path, (to or file) / path.parent.relative_to(file), found=True)
            for path in inside if new is None or new not in path.resolve().parents]
