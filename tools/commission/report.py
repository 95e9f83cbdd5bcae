"""The report of a commissioning: each run of each stage, in a JSON file that a lab keeps with its configuration."""

from __future__ import annotations

import contextlib
import dataclasses
import getpass
import hashlib
import json
import os
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final

from trocar.procs.document.system import SystemConfig
from trocar.tools.commission.finding import Outcome
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import plain

FORMAT: Final = 1


@dataclass(frozen=True, slots=True)
class Try:
    """One run of a stage: when it ended (local time), who ran it, on which boards, and with which files."""

    stage: str
    passed: bool
    when: str
    seconds: float
    who: str
    boards: str  # real or emulated
    files: str  # fingerprint of the files' content about the robots, except calibrated values
    problems: tuple[str, ...]
    notes: tuple[str, ...]
    figures: dict[str, Any]
    made: tuple[str, ...] = ()  # files that it has written, relative to the report


class CommissionReport:
    """All runs; saved after each."""

    def __init__(self, path: Path, system: str) -> None:
        """Read an existing report; Problem if it is invalid, or of another system."""
        self.path, self.system = path, system
        self.tries: list[Try] = []
        if path.exists():
            try:
                content = json.loads(path.read_text(encoding="utf-8"))
                rows = content["tries"] if content["format"] == FORMAT else None
                if rows is None:
                    raise ValueError(f"format {content['format']}")
                self.tries = [Try(**{**row, **{key: tuple(row.get(key, ())) for key in ("problems", "notes", "made")}})
                              for row in rows]
                known = str(content["system"])
            except (OSError, ValueError, LookupError, TypeError) as error:
                raise Problem(f"{path} is no report of commissioning ({error}); --report names another file") from None
            if known != system:
                raise Problem(f"{path} is the report of {known}, not of {system}; --report names another file")

    def last(self, stage: str, boards: str, files: str) -> Try | None:
        """The newest run of a stage on these boards with these files."""
        rows = [row for row in self.tries if (row.stage, row.boards, row.files) == (stage, boards, files)]
        return rows[-1] if rows else None

    def passed(self, stage: str, boards: str, files: str) -> bool:
        """Whether the newest run of a stage on these boards with these files passed."""
        row = self.last(stage, boards, files)
        return row is not None and row.passed

    def add(self, stage: str, outcome: Outcome, seconds: float, boards: str, files: str) -> Try:
        """Add a run, and save the report."""
        row = Try(stage, not outcome.problems, datetime.now().astimezone().isoformat(timespec="seconds"),
                  round(seconds, 1), getpass.getuser(), boards, files, tuple(map(str, outcome.problems)),
                  tuple(outcome.notes), plain(outcome.figures),
                  tuple(os.path.relpath(file, self.path.parent) for file in outcome.files))
        self.tries.append(row)
        self._save()
        return row

    @property
    def made(self) -> list[Path]:
        """The files that all runs have written."""
        return [self.path.parent / file for row in self.tries for file in row.made if isinstance(file, str)]

    def require_writable(self) -> None:
        """Problem if the report could not be saved; changes nothing."""
        with self._fresh():
            pass

    def _save(self) -> None:
        content = {"format": FORMAT, "system": self.system, "tries": [dataclasses.asdict(row) for row in self.tries]}
        with self._fresh() as fresh:
            fresh.write_text(json.dumps(content, indent=2, ensure_ascii=False) + "\n", encoding="utf-8")
            fresh.replace(self.path)

    @contextlib.contextmanager
    def _fresh(self) -> Iterator[Path]:
        """A new file beside the report, which replaces it or is removed; Problem if it cannot be written."""
        fresh = self.path.with_name(f".{self.path.name}.{os.getpid()}")
        try:
            fresh.touch()
            yield fresh
            fresh.unlink(missing_ok=True)
        except OSError as bad:
            with contextlib.suppress(OSError):
                fresh.unlink(missing_ok=True)
            why = bad.strerror or bad
            raise Problem(f"{self.path} cannot be written: {why}; --report names another file") from None


def fingerprint(system: SystemConfig) -> str:
    """A hash of all that the files say about the robots, except names of files and values that calibration changes."""
    rows = [dataclasses.asdict(robot) for io in system.ios if io.port for robot in io.robots]
    for row in rows:
        del row["source"], row["lookup"]
        for actuator in row["actuators"]:
            if actuator["potentiometer"] is not None:
                del actuator["potentiometer"]["voltage_to_position"]
        for brake in row["brakes"]:
            del brake["release_current"], brake["released_current"]
        for drive in (*row["actuators"], *row["brakes"]):
            del drive["current_to_bits"]["offset"], drive["bits_to_current"]["offset"]
    return hashlib.sha256(json.dumps(rows, sort_keys=True).encode()).hexdigest()[:12]
