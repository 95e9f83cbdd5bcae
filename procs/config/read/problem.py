"""Problems of a configuration as values: file, line, key path, value, and allowed values."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass

KeyPath = tuple[str | int, ...]

ERROR = "error"
WARNING = "warning"

_MAX_VALUE = 60


@dataclass(frozen=True, slots=True)
class FileProblem:
    """One finding; `str()` makes one line of it. `line` 0 means the whole file, `key` "" the whole document."""

    file: str
    line: int
    key: str
    value: str
    text: str
    allowed: str = ""
    severity: str = ERROR

    def __str__(self) -> str:
        place = f"{self.file}:{self.line}" if self.line else self.file
        parts = [f"{place}: {self.severity}"]
        if self.key:
            parts.append(f"{self.key} = {self.value}" if self.value else self.key)
        elif self.value:
            parts.append(self.value)
        parts.append(f"{self.text}; allowed: {self.allowed}" if self.allowed else self.text)
        return " ".join(": ".join(parts).split())


def count(problems: Iterable[FileProblem], severity: str = ERROR) -> int:
    """Number of findings with this severity."""
    return sum(problem.severity == severity for problem in problems)


def key_text(key: KeyPath) -> str:
    """A key path as text: ("robots", 0, "name") is `robots[0].name`."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            text += f".{part}" if text else part
    return text


def value_text(value: object) -> str:
    """A value as in the file, shortened."""
    try:
        text = json.dumps(value, ensure_ascii=False)
    except (TypeError, ValueError):
        text = repr(value)
    if len(text) > _MAX_VALUE and isinstance(value, list):
        text = f"a list of {len(value)}"
    elif len(text) > _MAX_VALUE and isinstance(value, dict):
        text = "an object"
    elif len(text) > _MAX_VALUE:
        text = text[: _MAX_VALUE - 1] + "…"
    return text
