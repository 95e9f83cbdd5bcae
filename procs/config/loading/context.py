"""What loading a system carries along: where to look, what was found wrong, what was noted."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Generic, TypeVar

from pydantic import BaseModel

from trocar.procs.config.read.problem import WARNING, FileProblem, Key
from trocar.procs.config.read.search import SearchPath
from trocar.procs.config.read.source import SourceFile, read_source
from trocar.procs.config.read.validate import validate
from trocar.procs.document import system as document
from trocar.procs.machine.paths import ADDS_FOLDER

ADDED: Final = f"{ADDS_FOLDER}, for stock files the dVRK's sawIntuitiveResearchKit/share"
ModelType = TypeVar("ModelType", bound=BaseModel)


@dataclass(frozen=True, slots=True)
class Opened(Generic[ModelType]):
    """A file and what it says."""

    source: SourceFile
    content: ModelType


@dataclass(slots=True)
class Context:
    """Collects every finding, so that one run names all mistakes and not only the first."""

    search: SearchPath
    problems: list[FileProblem] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    calibration_mode: bool = False  # what a calibration is to mend is a warning
    tools: dict[Path, document.Tool | None] = field(default_factory=dict)  # files read already

    def error(self, source: SourceFile, key: Key, text: str, allowed: str = "") -> None:
        """An error at a place of a file."""
        self.problems.append(source.problem(key, text, allowed=allowed))

    def warning(self, source: SourceFile, key: Key, text: str, allowed: str = "") -> None:
        """A warning at a place of a file."""
        self.problems.append(source.problem(key, text, allowed=allowed, severity=WARNING))

    def read(self, path: Path) -> SourceFile | None:
        """Any file; None (and an error) when it cannot be read."""
        source, problems = read_source(path)
        self.problems += problems
        return source

    def open(self, model: type[ModelType], path: Path) -> Opened[ModelType] | None:
        """A file as `model`; None (and errors) when it is not one."""
        source = self.read(path)
        if source is None:
            return None
        source = source.renamed(getattr(model, "OLD_KEYS", {}))
        content, problems = validate(model, source)
        self.problems += problems
        return Opened(source, content) if content is not None else None

    def find(self, asked_by: SourceFile, key: Key, names: tuple[str, ...],
             search: SearchPath | None = None) -> Path | None:
        """The file called by one of `names`; an error at `key` of the file that asks for it when there is none."""
        where = search or self.search
        found = where.find(*names)
        if found is None:
            nearest = where.nearest(names[0])
            hint = f" (did you mean {nearest}?)" if nearest else ""
            text = f"no file {' or '.join(names)}{hint}; looked in {where}"
            self.error(asked_by, key, text, f"a file on the search path; {ADDED}")
        return found
