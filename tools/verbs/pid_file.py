"""A PID file with the gains a running system has: what else its file of origin says is kept, nothing gets lost."""

from __future__ import annotations

import copy
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from trocar.procs.config.models.io_file import PidFile
from trocar.procs.config.read.source import SourceFile, read_source
from trocar.procs.config.read.validate import validate
from trocar.procs.document.gains import GAINS, value_of
from trocar.tools.converters import to_json
from trocar.tools.inspect.gains import Present
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.output.replacing import put


@dataclass(slots=True)
class SavedPidFile:
    """What was written: the values that are not those of the file of origin, by the names that `pid show` has for them;
    where an overwritten file went."""

    changed: list[str]
    backup: Path | None = None
    notes: list[str] = field(default_factory=list)


def save_as(gains: Present, file: Path, *, force: bool) -> SavedPidFile:
    """Write `gains` to `file`, whole or not at all; Problem when that cannot be done or would overwrite something."""
    if file.suffix != ".json":
        raise Misuse(f"{file}: a PID file is called NAME.json")
    if file.exists() and not force:
        raise Problem(f"{file} is there already; --force overwrites it and keeps the old content beside it")
    data, notes = _origin(gains)
    saved = SavedPidFile(_put(gains, data), notes=notes)
    saved.backup = put(file, to_json(data), lambda fresh: _check(gains, fresh))
    if saved.backup is not None:
        saved.notes.append(f"the previous {file} was saved as {saved.backup}")
    return saved


def _origin(gains: Present) -> tuple[dict[str, Any], list[str]]:
    """The content of the file that the gains came from, and what of it the new file cannot have."""
    if not gains.file:
        raise Problem(f"{gains.robot} has no PID file, and no gains to save")
    path = Path(gains.file)
    source, problems = read_source(path)
    if source is None:
        raise Problem(f"{gains.robot} was started with gains from a file that can no longer be read: {problems[0]}")
    content, problems = validate(PidFile, source)
    if content is None:
        raise Problem(f"{gains.robot} has its gains from a file that has changed since: {problems[0]}")
    rows = content.pid
    if [row.name for row in rows] != list(gains.names):
        raise Problem(f"{path} has other actuators than {gains.robot} was started with: {', '.join(gains.names)}")
    notes = []
    if rows != gains.start:
        notes.append(f"{path} has changed since the system was started; the gains in use were saved")
    if _loses_comments(source):
        notes.append(f"comments of {path} are not in the new file")
    return copy.deepcopy(source.data), notes


def _loses_comments(source: SourceFile) -> bool:
    text = source.path.read_text(encoding="utf-8-sig")
    if source.path.suffix != ".json":
        return "#" in text
    try:
        json.loads(text)
    except ValueError:  # it could be read, so it is JSON but for comments
        return True
    return False


def _put(gains: Present, data: dict[str, Any]) -> list[str]:
    """Write what differs into the rows of `data`; returns the names of those values."""
    content, _ = validate(PidFile, SourceFile(Path(gains.file), data, {}))
    assert content is not None
    changed = []
    for axis, row in enumerate(content.pid):
        for gain in GAINS:
            value = gains.row(axis)[gain.key]
            if value != value_of(row, gain.key):
                data["pid"][axis][gain.key] = bool(value) if gain.switch else value
                changed.append(f"{axis} {gains.names[axis]} {gain.key}")
    return changed


def _check(gains: Present, file: Path) -> None:
    """Whatever was written must read back as what runs, to the last digit."""
    source, problems = read_source(file)
    content = None
    if source is not None:
        content, problems = validate(PidFile, source)
    rows = content.pid if content is not None else ()
    same = len(rows) == len(gains.names) and all(
        value_of(row, gain.key) == gains.values[gain.key][axis] for axis, row in enumerate(rows) for gain in GAINS)
    if not same:
        raise Problem(f"gains of {gains.robot} cannot be written to a PID file: {problems[0] if problems else file}")
