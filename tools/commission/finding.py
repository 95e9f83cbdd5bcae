"""Findings of a commissioning stage: problems that stop it, figures for the report, remarks."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any


@dataclass(frozen=True, slots=True)
class Finding:
    """A violation: place (robot, axis, board), observation, allowed values (empty: the system's own error), remedy."""

    where: str
    seen: str
    allowed: str
    remedy: str

    def __str__(self) -> str:
        allowed = f"; allowed: {self.allowed}" if self.allowed else ""
        return f"{self.where}: {self.seen}{allowed}; {self.remedy}"


@dataclass(slots=True)
class Outcome:
    """Result of a stage: passed if there are no problems."""

    problems: list[Finding] = field(default_factory=list)
    figures: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    files: list[Path] = field(default_factory=list)  # those that it has written

    def add(self, found: list[Finding]) -> bool:
        """Note problems; whether there are any."""
        self.problems += found
        return bool(found)
