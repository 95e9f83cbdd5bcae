"""Fate of every key of an old file: converted, defaulted, dropped, lost; and the problems of the file."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from dataclasses import dataclass, field

from trocar.procs.config.read.problem import FileProblem

CONVERTED = "converted"  # its value is in the new file in another unit or under another name
DEFAULTED = "defaulted"  # missing in the old file; required in the new one
DROPPED = "dropped"  # no longer needed
LOST = "lost"  # the new format cannot express it, or needs data missing in the old one: a person must decide

Json = dict[str, object]
NOT_READ = "the original software did not read it"
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?\Z")


@dataclass(frozen=True, slots=True)
class Change:
    """One changed key; `str()` returns it on one line. `line` 0: the old file has no such line."""

    file: str
    line: int
    outcome: str
    key: str
    old: str
    new: str
    reason: str

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.line else self.file
        was = f"{self.key} = {self.old}" if self.old else self.key
        now = f" → {self.new}" if self.new else ""
        why = f" ({self.reason})" if self.reason else ""
        return f"{place}: {self.outcome}: {was}{now}{why}"


@dataclass(frozen=True, slots=True)
class Reference:
    """A file named in an old one: its name there, and the file that replaces it from now on."""

    line: int
    key: str
    old: str
    new: str
    converted_with_it: bool  # by the same run


@dataclass(slots=True)
class ConversionReport:
    """Collects changes and problems while one file is converted.

    `follow` returns the present name of a file converted in the same run, by its name in files; "" for others.
    """

    file: str
    follow: Callable[[str], str] = lambda name: ""
    references: list[Reference] = field(default_factory=list)
    changes: list[Change] = field(default_factory=list)
    problems: list[FileProblem] = field(default_factory=list)

    def converted(self, line: int, key: str, old: str, new: str, reason: str = "") -> None:
        """The value is in the new file in another form."""
        self.changes.append(Change(self.file, line, CONVERTED, key, old, new, reason))

    def defaulted(self, line: int, key: str, new: str, reason: str) -> None:
        """`key`, which the old file does not have, is `new` from now on."""
        self.changes.append(Change(self.file, line, DEFAULTED, key, "", new, reason))

    def dropped(self, line: int, key: str, old: str, reason: str) -> None:
        """The new format does without."""
        self.changes.append(Change(self.file, line, DROPPED, key, old, "", reason))

    def lost(self, line: int, key: str, old: str, reason: str) -> None:
        """The new format cannot express it, or needs missing data; `reason` gives the remedy."""
        self.changes.append(Change(self.file, line, LOST, key, old, "", reason))

    def error(self, line: int, key: str, value: str, text: str, allowed: str = "") -> None:
        """An error in the file; no output is written."""
        self.problems.append(FileProblem(self.file, line, key, value, text, allowed))


def finite(text: str) -> float | None:
    """The number in a text; None for another text, or infinity."""
    value = float(text) if _NUMBER.match(text) else math.inf
    return value if math.isfinite(value) else None


def number_text(value: float, unit: str = "") -> str:
    """A number as people write it, with its unit."""
    return f"{value:.9g} {unit}".rstrip()
