"""Files with calibrated values: of IO files, the rest is unchanged; nothing is overwritten without a copy."""

from __future__ import annotations

import copy
import difflib
import json
import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from trocar.procs.config import check_file
from trocar.procs.config.read.source import REHEARSED as MARK
from trocar.procs.config.read.source import read_source
from trocar.tools.commission.bench import RunningBench
from trocar.tools.commission.finding import Outcome
from trocar.tools.converters import to_json
from trocar.tools.output.errors import Problem
from trocar.tools.output.replacing import put

Place = tuple[str | int, ...]
"""Keys and indices from a robot to a number."""
Values = Mapping[str, Mapping[Place, float]]
"""By robot and place."""
KEYS: Final = {"robots": "IO_file", "arms": "arm_file"}
"""Of the system file, by the list in the named file."""
DIGITS: Final = 9  # of the written numbers
CALIBRATED, REHEARSED = "calibrated", "rehearsed"
"""In the names of new files: from a real robot; from an emulated one, which must never replace those of a real one."""
OF_EMULATED: Final = "has values of the emulated robot, for this rehearsal; yours has others"


@dataclass(slots=True)
class SavedIoFile:
    """The written file, the changed lines, all files made, further remarks."""

    path: Path
    diff: str
    files: list[Path]
    notes: list[str] = field(default_factory=list)


def save(source: Path, values: Values, folder: Path, *, write: bool, rehearsed: bool = False,
         part: str = "robots") -> SavedIoFile:
    """Put values into a new file `NAME-calibrated.json` in `folder`, or with `write` into the file itself.

    `part`: the list with the named robots, or arms. `rehearsed`: the values are those of an emulated robot, and the new
    file is `NAME-rehearsed.json`. Problem if that fails; then nothing has changed.
    """
    read, problems = read_source(source)
    if read is None:
        raise Problem(f"{source} can no longer be read: {problems[0]}")
    require_place(source, folder, write=write)
    data = copy.deepcopy(read.data)
    _put(data, values, source, part)
    data = _marked(data) if rehearsed else data
    old, new = to_json(read.data), to_json(data)
    path = source if write else folder / f"{source.stem}-{REHEARSED if rehearsed else CALIBRATED}.json"
    diff = "".join(difflib.unified_diff(old.splitlines(True), new.splitlines(True), str(source), str(path), n=0))
    saved = SavedIoFile(path, diff, [path])
    if (kept := put(path, new, lambda fresh: _check(path, fresh, source.parent))) is not None:
        saved.files.append(kept)
        saved.notes.append(f"{path} was there; it is {kept} now")
    use = "" if write else f"; use it in place of {source.name} ({KEYS[part]} of the system file)"
    saved.notes.append(f"{path} {OF_EMULATED}" if rehearsed else f"{path} has the calibrated values{use}")
    return saved


def require_place(source: Path, folder: Path, *, write: bool) -> None:
    """Problem if `save` could not write there; changes nothing."""
    if write and source.suffix != ".json":
        raise Problem(f"{source} is no JSON and would lose its comments; without --write a new file is written")
    into = source.parent if write else folder
    if not os.access(into, os.W_OK | os.X_OK):
        raise Problem(f"{into}: no file can be written into this folder")


def save_all(bench: RunningBench, outcome: Outcome, changes: Mapping[str, Values], folder: Path, *,
             write: bool, part: str = "robots") -> Outcome:
    """`save` the values of each file, and show the person the changed lines; returns the outcome."""
    rehearsed = bench.document.emulation is not None
    for source, values in changes.items():
        saved = save(Path(source), values, folder, write=write, rehearsed=rehearsed, part=part)
        bench.person.report(saved.diff or f"{source}: nothing changes")
        outcome.notes += saved.notes
        outcome.files += saved.files
    return outcome


def save_new(bench: RunningBench, outcome: Outcome, path: Path, content: Mapping[str, Any], what: str,
             beside: Path) -> None:
    """A whole file of JSON, named `-rehearsed` if the robot is emulated; its old content is kept.

    `what` it is, in words; `beside`: the file in whose folder it is used. Problem if it would not be valid.
    """
    rehearsed = bench.document.emulation is not None
    path = path.with_stem(f"{path.stem}-{REHEARSED}") if rehearsed else path
    content = _marked(content) if rehearsed else content
    kept = put(path, json.dumps(content), lambda fresh: _check(path, fresh, beside.parent))
    outcome.files += [path, kept] if kept else [path]
    note = f"{path} is {what}"
    if rehearsed:
        note = f"{path} {OF_EMULATED}"
    elif path.resolve().parent != beside.resolve().parent:
        note += f"; put it beside {beside}"
    outcome.notes.append(note + (f"; the file that was there is {kept}" if kept else ""))


def line_of(axis: int, scale: float, offset: float) -> dict[Place, float]:
    """The values of a potentiometer's line."""
    where = ("actuators", axis, "potentiometer", "voltage_to_position")
    return {(*where, "scale"): scale, (*where, "offset"): offset}


def texts_of(source: str, part: str, key: str) -> dict[str, str]:
    """A text of each robot, or arm, of a file; Problem if the file cannot be read."""
    read, problems = read_source(Path(source))
    if read is None:
        raise Problem(f"{source} can no longer be read: {problems[0]}")
    data: dict[str, Any] = read.data
    return {str(row.get("name")): str(row.get(key, "")) for row in data.get(part, [])}


def _marked(content: Mapping[str, Any]) -> dict[str, Any]:
    """The content with the mark by which real boards refuse it, under any name."""
    return {MARK: True, **content}


def _put(data: dict[str, Any], values: Values, source: Path, part: str) -> None:
    if lost := set(values) - {str(robot.get("name")) for robot in data.get(part, [])}:
        raise Problem(f"{source} has changed: {part.removesuffix('s')} {', '.join(sorted(lost))} is missing")
    for robot in data.get(part, []):
        for place, value in values.get(str(robot.get("name")), {}).items():
            named = f"{robot['name']} {'.'.join(map(str, place))}"
            if not math.isfinite(value):
                raise Problem(f"{named}: {value:g} cannot be written")
            into: Any = robot
            try:
                for key in place[:-1]:
                    into = into[key]
                into[place[-1]] = float(f"{value:.{DIGITS}g}")
            except (LookupError, TypeError):
                raise Problem(f"{source} has changed: {named} is missing") from None


def _check(path: Path, fresh: Path, beside: Path) -> None:
    """Problem if the future content of `path`, used in the folder `beside`, has errors."""
    errors = [problem for problem in check_file(fresh, search=[beside]).problems if problem.severity == "error"]
    if errors:
        raise Problem(f"{path} would not be valid: {errors[0]}")
