"""The context of loading a system: search path, problems and notes."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Generic, TypeAlias, TypeVar

from pydantic import BaseModel

from trocar.procs.config.read.problem import WARNING, FileProblem, KeyPath
from trocar.procs.config.read.search import SearchPath, search_beside
from trocar.procs.config.read.source import REHEARSED, SourceFile, read_source
from trocar.procs.config.read.validate import validate
from trocar.procs.document import system as document
from trocar.procs.machine.paths import ADDS_FOLDER, is_folder

MEASURES: Final = "trocar commission SYSTEM, stage %s,"
"""The remedy for a value or a file that a stage of commissioning makes."""
ADDED: Final = f"{ADDS_FOLDER}, for stock files the dVRK's sawIntuitiveResearchKit/share"
NO_FOLDER: Final = "no such folder", "a folder"
"""Of a folder on the search path: other files than those meant would be found."""
OF_EMULATED: Final = "this file has values of the emulated robot (a rehearsal): put the arm's own file back"
ModelType = TypeVar("ModelType", bound=BaseModel)
Content = TypeVar("Content", covariant=True)
Part = TypeVar("Part")
Where: TypeAlias = str | KeyPath
"""A key inside a part of a file: names joined by dots (`drive.maximum_current`), or a path; empty: the part itself."""


@dataclass(slots=True)
class Context:
    """Collects all findings, so that one run reports all mistakes, not only the first."""

    search: SearchPath
    problems: list[FileProblem] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    calibration_mode: bool = False  # values that a calibration will fix cause only warnings
    rehearsed: str = WARNING  # severity of a file with values of the emulated robot; "": none, with emulated boards
    tools: dict[Path, document.Tool | None] = field(default_factory=dict)  # cache of tool files
    _read: dict[Path, _Reading[None]] = field(default_factory=dict)  # each file is read once
    _opened: dict[tuple[Path, type[BaseModel]], _Reading[Any]] = field(default_factory=dict)
    _searches: dict[tuple[SearchPath, tuple[Path, ...]], SearchPath] = field(default_factory=dict)

    @classmethod
    def beside(cls, files: Sequence[Path], search: Sequence[Path], configs: Path) -> Context:
        """That of `files` from a command line, see `search_beside`; an error for each `--path` that is no folder."""
        wrong = [FileProblem("--path", 0, "", str(path), *NO_FOLDER) for path in search if not is_folder(path)]
        return cls(search_beside(files, search, configs), wrong)

    def read(self, path: Path) -> Opened[None] | None:
        """Read any file; None (and an error) when that fails."""
        if path not in self._read:
            source, problems = read_source(path)
            if source is not None and source.has((REHEARSED,)):
                if self.rehearsed:
                    problems.append(source.problem((REHEARSED,), OF_EMULATED, severity=self.rehearsed,
                                                   allowed="only with emulated boards (--boards emulated)"))
                source = source.without(REHEARSED)
            self._read[path] = Opened(self, source, None) if source is not None else None, problems
        return self._again(self._read[path])

    def open(self, model: type[ModelType], path: Path | None) -> Opened[ModelType] | None:
        """Read a file as `model`; None (and errors) when it is not valid; None without a path."""
        read = self.read(path) if path is not None else None
        if path is None or read is None:
            return None
        if (path, model) not in self._opened:
            source = read.source.renamed(getattr(model, "OLD_KEYS", {}))
            content, problems = validate(model, source)
            self._opened[path, model] = Opened(self, source, content) if content is not None else None, problems
        return self._again(self._opened[path, model])

    def _again(self, reading: _Reading[Content]) -> Opened[Content] | None:
        """A file read before; its problems are those of each of its readers."""
        self.problems += reading[1]
        return reading[0]

    def with_folders(self, folders: tuple[Path, ...]) -> SearchPath:
        """The search path with `folders` first, after the working folder."""
        known = (self.search, folders)
        if known not in self._searches:
            self._searches[known] = self.search.first(*folders)
        return self._searches[known]


@dataclass(frozen=True, slots=True)
class Opened(Generic[Content]):
    """A file, or the part of it at `key`, with its content; problems are added to its context."""

    context: Context
    source: SourceFile
    content: Content
    key: KeyPath = field(default=(), kw_only=True)

    def path(self, inner: Where) -> KeyPath:
        """The key of something inside, from the beginning of the file."""
        return (*self.key, *(inner if isinstance(inner, tuple) else filter(None, inner.split("."))))

    def at(self, inner: Where, content: Part) -> Opened[Part]:
        """A part of this part, with its content."""
        return Opened(self.context, self.source, content, key=self.path(inner))

    def each(self, inner: Where, rows: Iterable[Part]) -> Iterator[Opened[Part]]:
        """The rows of a list, each as a part."""
        part = self.at(inner, None)
        return (part.at((index,), row) for index, row in enumerate(rows))

    def has(self, inner: Where) -> bool:
        """Whether a key is written in the file."""
        return self.source.has(self.path(inner))

    def error(self, inner: Where, text: str, allowed: str = "") -> None:
        """Add an error at a key of this part."""
        self.context.problems.append(self.source.problem(self.path(inner), text, allowed=allowed))

    def unlisted(self, inner: Where, text: str, known: Iterable[str], otherwise: str = "") -> None:
        """Add an error at a key that must have one of the `known` values; `otherwise`: what to do if there is none."""
        names = ", ".join(known)
        self.error(inner, text, f"one of {names}" if names else otherwise)

    def warning(self, inner: Where, text: str, allowed: str = "") -> None:
        """Add a warning at a key of this part."""
        self.context.problems.append(self.source.problem(self.path(inner), text, allowed=allowed, severity=WARNING))

    def note(self, text: str) -> None:
        """Add a note, which is no mistake."""
        self.context.notes.append(text)

    def find(self, inner: Where, *names: str, beside: tuple[Path, ...] = (), stage: str = "") -> Path | None:
        """Find a file by one of `names`, first in `beside` (default: this file's folder); None with an error.

        `stage`: that of commissioning which makes the file: calibration mode starts without it, with a warning.
        """
        where = self.context.with_folders(beside or (self.source.path.parent,))
        found = where.find(*names)
        if found is None:
            nearest = where.nearest(names[0])
            hint = f" (did you mean {nearest}?)" if nearest else ""
            text = f"no file {' or '.join(names)}{hint}; looked in {where}"
            starts = bool(stage) and self.context.calibration_mode
            made = f"; {MEASURES % stage} makes it" if stage else ""
            made += "; until then, start with --calibration-mode" if stage and not starts else ""
            (self.warning if starts else self.error)(inner, text, f"a file on the search path; {ADDED}{made}")
        return found

    def open(self, model: type[ModelType], inner: Where, *names: str) -> Opened[ModelType] | None:
        """Find and read a file as `model`; None (and errors) when it is missing or not valid."""
        return self.context.open(model, self.find(inner, *names))


_Reading = tuple[Opened[Content] | None, list[FileProblem]]
