"""The context of loading a system: search path, problems and notes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Generic, TypeVar

from pydantic import BaseModel

from trocar.procs.config.read.problem import WARNING, FileProblem, KeyPath
from trocar.procs.config.read.search import SearchPath, search_beside
from trocar.procs.config.read.source import SourceFile, read_source
from trocar.procs.config.read.validate import validate
from trocar.procs.document import system as document
from trocar.procs.machine.paths import ADDS_FOLDER, is_folder

ADDED: Final = f"{ADDS_FOLDER}, for stock files the dVRK's sawIntuitiveResearchKit/share"
NO_FOLDER: Final = "no such folder", "a folder"
"""Of a folder on the search path: other files than those meant would be found."""
ModelType = TypeVar("ModelType", bound=BaseModel)
Content = TypeVar("Content", covariant=True)


@dataclass(slots=True)
class Context:
    """Collects all findings, so that one run reports all mistakes, not only the first."""

    search: SearchPath
    problems: list[FileProblem] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    calibration_mode: bool = False  # values that a calibration will fix cause only warnings
    tools: dict[Path, document.Tool | None] = field(default_factory=dict)  # cache of tool files

    @classmethod
    def beside(cls, files: Sequence[Path], search: Sequence[Path], configs: Path) -> Context:
        """That of `files` from a command line, see `search_beside`; an error for each `--path` that is no folder."""
        wrong = [FileProblem("--path", 0, "", str(path), *NO_FOLDER) for path in search if not is_folder(path)]
        return cls(search_beside(files, search, configs), wrong)

    def read(self, path: Path) -> Opened[None] | None:
        """Read any file; None (and an error) when that fails."""
        source, problems = read_source(path)
        self.problems += problems
        return Opened(self, source, None) if source is not None else None

    def open(self, model: type[ModelType], path: Path | None) -> Opened[ModelType] | None:
        """Read a file as `model`; None (and errors) when it is not valid; None without a path."""
        read = self.read(path) if path is not None else None
        if read is None:
            return None
        source = read.source.renamed(getattr(model, "OLD_KEYS", {}))
        content, problems = validate(model, source)
        self.problems += problems
        return Opened(self, source, content) if content is not None else None


@dataclass(frozen=True, slots=True)
class Opened(Generic[Content]):
    """A file with its content; problems are added to its context."""

    context: Context
    source: SourceFile
    content: Content

    def error(self, key: KeyPath, text: str, allowed: str = "") -> None:
        """Add an error at a key of this file."""
        self.context.problems.append(self.source.problem(key, text, allowed=allowed))

    def warning(self, key: KeyPath, text: str, allowed: str = "") -> None:
        """Add a warning at a key of this file."""
        self.context.problems.append(self.source.problem(key, text, allowed=allowed, severity=WARNING))

    def note(self, text: str) -> None:
        """Add a note, which is no mistake."""
        self.context.notes.append(text)

    def find(self, key: KeyPath, *names: str, beside: tuple[Path, ...] = ()) -> Path | None:
        """Find a file by one of `names`, first in `beside` (default: this file's folder); None with an error."""
        where = self.context.search.first(*(beside or (self.source.path.parent,)))
        found = where.find(*names)
        if found is None:
            nearest = where.nearest(names[0])
            hint = f" (did you mean {nearest}?)" if nearest else ""
            text = f"no file {' or '.join(names)}{hint}; looked in {where}"
            self.error(key, text, f"a file on the search path; {ADDED}")
        return found

    def open(self, model: type[ModelType], key: KeyPath, *names: str) -> Opened[ModelType] | None:
        """Find and read a file as `model`; None (and errors) when it is missing or not valid."""
        return self.context.open(model, self.find(key, *names))
