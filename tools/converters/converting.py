"""One run of `trocar convert`: its input files, output files, and the targets of references afterwards."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from trocar.procs.config import Checked, check_file
from trocar.procs.config.read.problem import WARNING, FileProblem, count
from trocar.procs.config.read.search import search_beside
from trocar.procs.config.read.source import read_bytes, read_source
from trocar.tools.converters.differences import differences
from trocar.tools.converters.jsonout import to_json
from trocar.tools.converters.recognise import OTHER, TODAY, UNKNOWN, Converted, convert_file, with_arm_file
from trocar.tools.converters.report import Reference
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import counted

SUFFIXES = (".xml", ".json", ".rob")
CHECKED = (".json", ".yaml", ".yml")
CONSOLE = "console"
SHOWN = 6  # differing values in a warning, files in a refusal
_NOTHING = Converted(OTHER, (), (), ())


@dataclass(slots=True)
class Result:
    """One file: its conversion, the files written or already present, and the findings of their check."""

    file: Path
    folder: Path  # destination of its new files
    data: bytes
    converted: Converted
    copies: bool = False  # it needs no change
    left_out: bool = False  # too large for a configuration file, or no file at all
    planned: dict[Path, bytes] = field(default_factory=dict)
    written: list[Path] = field(default_factory=list)
    equal: list[Path] = field(default_factory=list)
    problems: list[FileProblem] = field(default_factory=list)
    checks: list[Checked] = field(default_factory=list)
    had: int = 0  # errors in a copy that the file itself has as well

    @property
    def ok(self) -> bool:
        """Whether there are no problems, no losses, and valid output."""
        found = [problem for check in self.checks for problem in check.problems]
        return not self.converted.lost and not count((*self.problems, *found))


class Conversion:
    """All files of one call."""

    def __init__(self, files: Sequence[Path], to: Path | None, force: bool, path: Sequence[Path]) -> None:
        """`files` may be folders: all files in them; `to` gets the same folder structure."""
        self._force, self._path = force, tuple(path)
        self._olds = [old for file in files for old in _olds(file, to)]
        self._made: dict[Path, Path] = {}  # the first new file of every old one that is no console
        self._claimed: dict[Path, tuple[bytes, Path]] = {}  # outputs of this run, and the input of each

    def results(self) -> list[Result]:
        """Convert, write, then check: systems name the others.

        Problem, before any file is written, if a file cannot be written or would overwrite another.
        """
        results = [result for old in self._olds if (result := _read(*old)) is not None]
        for result in results:
            if result.converted.outputs and result.converted.kind != CONSOLE:
                self._made[result.file.resolve()] = result.folder / result.converted.outputs[0].name
        for result in sorted(results, key=lambda result: not result.copies):
            self._plan(result)
        self._need_way(results)
        for result in results:
            _write(result)
        for result in results:
            self._check(result)
        return results

    def _follow(self, result: Result, name: str) -> str:
        """The new name of a file that this run converts, as seen from the folder of the new system file."""
        for folder in (result.file.parent, *self._path):
            made = self._made.get((folder / name).resolve())
            if made is not None:
                return os.path.relpath(made, result.folder)
        return ""

    # -- checks before writing
    # -------------------------------------------------------------------------------------------

    def _plan(self, result: Result) -> None:
        """The places of all new files of a file, or of none; of two files the first one keeps its name."""
        if result.copies:
            planned = {result.folder / result.file.name: result.data}
        else:
            planned = self._new_files(result)
        clashes = [path for path, data in planned.items() if self._claimed.get(path, (data,))[0] != data]
        for path in clashes:
            text = f"this run makes another file of this name, from {self._claimed[path][1]}"
            result.problems.append(FileProblem(str(path), 0, "", "", text, "convert one of them --to another folder"))
        for path, data in {} if clashes else planned.items():
            if path in self._claimed or _is_equal(path, data):
                result.equal.append(path)
            else:
                result.planned[path] = data
            self._claimed.setdefault(path, (data, result.file))

    def _new_files(self, result: Result) -> dict[Path, bytes]:
        if result.converted.kind == CONSOLE:
            result.converted = convert_file(str(result.file), result.data, lambda name: self._follow(result, name))
            self._name_apart(result)
        planned = {}
        for output in result.converted.outputs:
            path = result.folder / output.name
            try:
                planned[path] = to_json(output.data).encode()
            except ValueError as bad:
                text = f"cannot be written as JSON: {bad}"
                result.problems.append(FileProblem(str(path), 0, "", "", text, "finite numbers"))
                return {}
        return planned

    def _name_apart(self, result: Result) -> None:
        """Another name for an arm file that two consoles make differently."""
        system, *arms = result.converted.outputs or (None,)
        for output in arms:
            path = result.folder / output.name
            if system is not None and path in self._claimed and self._claimed[path][0] != to_json(output.data).encode():
                new = f"{path.stem}-{Path(system.name).stem.removeprefix('system-')}.json"
                result.converted = with_arm_file(result.converted, str(result.file), output.name, new)

    def _need_way(self, results: list[Result]) -> None:
        planned = [path for result in results for path in result.planned]
        there = [path for path in planned if path.exists()]
        olds = {result.file.resolve() for result in results}
        own = [path for path in there if path.resolve() in olds]
        if own:
            raise Problem(f"nothing was written: {_listed(own)} would be overwritten by what it becomes; "
                          "--to FOLDER writes elsewhere")
        if there and not self._force:
            raise Problem(f"nothing was written: {_listed(there)} would be overwritten, with other content; "
                          "--force does that, --to FOLDER writes elsewhere")
        made: list[Path] = []
        place = Path()
        try:
            for place in dict.fromkeys(path.parent for path in planned):
                made += [folder for folder in (place, *place.parents) if not folder.exists()]
                place.mkdir(parents=True, exist_ok=True)
                tempfile.TemporaryFile(dir=place).close()
            for place in there:
                place.open("r+b").close()
        except OSError as bad:
            for folder in sorted(made, reverse=True):
                if folder.is_dir():
                    folder.rmdir()
            raise Problem(f"nothing was written: {place} cannot be written: {bad.strerror or bad}") from bad

    # -- afterwards ----------------------------------------------------------------------------------------------------

    def _check(self, result: Result) -> None:
        files = [path for path in (*result.written, *result.equal) if path.suffix.lower() in CHECKED]
        checks = [check_file(new, search=self._path) for new in files]
        if result.copies:
            checks = [check for check in checks if check.kind != UNKNOWN and count(check.problems)]
            if checks:
                had = {(found.line, found.key, found.value)
                       for found in check_file(result.file, search=self._path).problems}
                result.had = count([found for check in checks for found in check.problems
                                    if (found.line, found.key, found.value) in had])
        result.checks = checks
        if files and result.converted.kind == CONSOLE:
            result.problems += self._stock_in_place_of_own(files[0], result)

    def _stock_in_place_of_own(self, system: Path, result: Result) -> Iterable[FileProblem]:
        """Stock files that replace files of the site's own from now on: with the differing values."""
        folders = search_beside([system], self._path)
        for reference in result.converted.references:
            own = next((folder / reference.old for folder in (result.file.parent, *self._path)
                        if (folder / reference.old).is_file()), None)
            stock = folders.find(reference.new)
            if reference.converted_with_it or own is None or stock is None or stock.samefile(own):
                continue
            changed = _changed(own, stock)
            if changed:
                yield _fallback(result.file, reference, own, stock, changed)


def _read(file: Path, folder: Path, found: bool) -> Result | None:
    """Conversion of a file; None for one `found` in a folder that needs no change and stays in place."""
    stays, maybe_old = folder.resolve() == file.parent.resolve(), not found or file.suffix.lower() in SUFFIXES
    if stays and not maybe_old:
        return None
    data, problem = read_bytes(file)
    if problem is not None:
        told = replace(problem, text=f"left out: {problem.text}", severity=WARNING) if found else problem
        return Result(file, folder, data, _NOTHING, left_out=found, problems=[told])
    converted = convert_file(str(file), data) if maybe_old else _NOTHING
    copies = converted.kind == TODAY or (found and converted.kind == OTHER)
    is_strange = copies and file.suffix.lower() == ".xml"
    if found and stays and copies and not is_strange:
        return None
    problems = [replace(problem, text=f"not converted: {problem.text}", severity=WARNING)
                for problem in converted.problems] if is_strange else () if copies else converted.problems
    return Result(file, folder, data, converted, copies, problems=list(problems))


def _write(result: Result) -> None:
    for path, data in result.planned.items():
        try:
            if result.copies:
                shutil.copy2(result.file, path)
            else:
                path.write_bytes(data)
        except OSError as bad:
            result.problems.append(FileProblem(str(path), 0, "", "", f"cannot be written: {bad.strerror or bad}"))
            return
        result.written.append(path)


def _is_equal(path: Path, data: bytes) -> bool:
    try:
        return path.is_file() and path.read_bytes() == data
    except OSError:
        return False


def _listed(paths: Sequence[Path]) -> str:
    more = f" and {len(paths) - SHOWN} more" if len(paths) > SHOWN else ""
    return f"{', '.join(map(str, paths[:SHOWN]))}{more}"


def _changed(own: Path, stock: Path) -> list[str]:
    converted = convert_file(str(own), own.read_bytes())
    source, _ = read_source(stock)
    if not converted.outputs or source is None:
        return []
    return differences(converted.outputs[0].data, source.data)


def _fallback(console: Path, reference: Reference, own: Path, stock: Path, changed: list[str]) -> FileProblem:
    more = f"; and {len(changed) - SHOWN} more" if len(changed) > SHOWN else ""
    text = (f"{stock} is read in the place of {own}, and differs in {counted(len(changed), 'value')}: "
            f"{'; '.join(changed[:SHOWN])}{more}")
    allowed = f"convert {own.name} in the same run, and name what it becomes in the system file"
    return FileProblem(str(console), reference.line, reference.key, reference.old, text, allowed, WARNING)


def _olds(file: Path, to: Path | None) -> Iterator[tuple[Path, Path, bool]]:
    """A file, the folder of its new files, and whether it was found in a folder: files of a folder may be any, except
    hidden ones and outputs of an earlier run to `to`.
    """
    if not file.is_dir():
        yield file, to or file.parent, False
        return
    new = to.resolve() if to is not None and to.resolve() != file.resolve() else None
    for path in sorted(file.rglob("*")):
        inner = path.relative_to(file)
        hidden = any(part.startswith(".") for part in inner.parts)
        if not hidden and not path.is_dir() and (new is None or new not in path.resolve().parents):
            yield path, (to or file) / inner.parent, True
