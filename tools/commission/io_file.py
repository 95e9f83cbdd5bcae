"""An IO file with other potentiometer values: the rest is unchanged, and nothing is overwritten without a copy."""

from __future__ import annotations

import copy
import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from trocar.procs.config import check_file
from trocar.procs.config.read.source import read_source
from trocar.tools.converters import to_json
from trocar.tools.output.errors import Problem
from trocar.tools.output.replacing import put

Values = Mapping[str, Mapping[int, tuple[float, float]]]  # by robot and axis: scale and offset
DIGITS: Final = 9  # of the written numbers


@dataclass(slots=True)
class SavedIoFile:
    """The written file, the changed lines, further remarks."""

    path: Path
    diff: str
    notes: list[str] = field(default_factory=list)


def save(source: Path, values: Values, folder: Path, *, write: bool, rehearsed: bool = False) -> SavedIoFile:
    """Put values into a new file `NAME-calibrated.json` in `folder`, or with `write` into the file itself.

    `rehearsed`: they are those of an emulated robot. Problem if that fails; then nothing has changed.
    """
    read, problems = read_source(source)
    if read is None:
        raise Problem(f"{source} can no longer be read: {problems[0]}")
    if write and source.suffix != ".json":
        raise Problem(f"{source} is no JSON and would lose its comments; without --write a new file is written")
    data = copy.deepcopy(read.data)
    _put(data, values, source)
    old, new = to_json(read.data), to_json(data)
    path = source if write else folder / f"{source.stem}-calibrated.json"
    diff = "".join(difflib.unified_diff(old.splitlines(True), new.splitlines(True), str(source), str(path), n=0))
    saved = SavedIoFile(path, diff)
    if (kept := put(path, new, lambda fresh: _check(path, fresh))) is not None:
        saved.notes.append(f"{path} was there; it is {kept} now")
    use = "" if write else f"; use it in place of {source.name} (IO_file of the system file)"
    saved.notes.append(f"{path} has values of the emulated robot; yours has others: do not use it" if rehearsed
                       else f"{path} has the calibrated values{use}")
    return saved


def _put(data: dict[str, Any], values: Values, source: Path) -> None:
    for robot in data.get("robots", []):
        for axis, (scale, offset) in values.get(str(robot.get("name")), {}).items():
            try:
                pot = robot["actuators"][axis]["potentiometer"]
            except (LookupError, TypeError):
                raise Problem(f"{source} has changed: the potentiometer of axis {axis} is missing") from None
            if not (math.isfinite(scale) and math.isfinite(offset)):
                raise Problem(f"{robot['name']} axis {axis}: {scale:g} and {offset:g} cannot be written")
            pot["voltage_to_position"] = {**pot.get("voltage_to_position", {}), "scale": _rounded(scale),
                                          "offset": _rounded(offset)}


def _rounded(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")


def _check(path: Path, fresh: Path) -> None:
    """Problem if the future content of `path` has errors."""
    errors = [problem for problem in check_file(fresh).problems if problem.severity == "error"]
    if errors:
        raise Problem(f"{path} would not be valid: {errors[0]}")
