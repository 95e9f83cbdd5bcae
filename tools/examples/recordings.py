"""Recordings of a master as CSV: its tip poses, gripper and buttons.

The first line names the columns: `time` (s, growing), `x y z` (m), `qx qy qz qw` (length 1), then optionally `gripper`
(rad), and any number of buttons by the names that the console uses (0 or 1). Lines that begin with # are comments.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.kinematics.poses import PoseError, matrix_from_pose, normalised, rotation_vector
from trocar.tools.output.errors import Problem

Array = NDArray[np.float64]

TIME: Final = "time"
POSE: Final = ("x", "y", "z", "qx", "qy", "qz", "qw")
GRIPPER: Final = "gripper"


@dataclass(frozen=True, slots=True)
class Moment:
    """State of a master at one time: pose (7,), twist (6,), gripper (None: it has none), pressed buttons."""

    pose: Array
    twist: Array
    gripper: float | None
    pressed: frozenset[str]


class Recording:
    """All rows of a file, and interpolation between them."""

    def __init__(self, times: Array, poses: Array, gripper: Array | None, buttons: dict[str, Array]) -> None:
        """Times (n,) from 0 on, growing, poses (n, 7), gripper (n,) rad, buttons (n,) 0 or 1."""
        self.times, self.poses, self.gripper, self.buttons = times, poses, gripper, buttons

    @property
    def seconds(self) -> float:
        """Its duration."""
        return float(self.times[-1])

    def at(self, seconds: float, pace: float = 1.0) -> Moment:
        """Between two rows in a straight line, turning about one axis; `pace` (-1: backwards) is that of the twist."""
        after = min(max(1, int(np.searchsorted(self.times, seconds, side="right"))), len(self.times) - 1)
        first, second = self.poses[after - 1], self.poses[after]
        lasts = float(self.times[after] - self.times[after - 1])
        part = min(1.0, max(0.0, (seconds - float(self.times[after - 1])) / lasts))
        pose = np.concatenate((first[:3] + part * (second[:3] - first[:3]), _between(first[3:], second[3:], part)))
        turn = matrix_from_pose(second)[:3, :3] @ matrix_from_pose(first)[:3, :3].T
        twist = np.concatenate((second[:3] - first[:3], rotation_vector(turn))) * (pace / lasts)
        inside = 0.0 < seconds < self.seconds
        gripper = float(np.interp(seconds, self.times, self.gripper)) if self.gripper is not None else None
        row = after if part >= 1.0 else after - 1
        pressed = frozenset(name for name, values in self.buttons.items() if values[row] > 0.5)
        return Moment(pose, twist if inside else np.zeros(6), gripper, pressed)


def read_recording(path: Path) -> Recording:
    """The recording in a file; Problem names the line and its error."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise Problem(f"{path}: cannot be read: {error}") from None
    rows = ((number, line) for number, line in enumerate(lines, 1) if line.strip() and not line.startswith("#"))
    number, head = next(rows, (0, ""))
    names = [name.strip() for name in next(csv.reader([head]), [])]
    missing = [name for name in (TIME, *POSE) if name not in names]
    if missing or len(set(names)) < len(names):
        what = f"has no column {', '.join(missing)}" if missing else "names a column twice"
        raise Problem(f"{path}:{number}: the first line {what}; it must name {TIME}, {', '.join(POSE)}, then as you "
                      f"like {GRIPPER} and buttons")
    table = np.array(list(_rows(path, rows, names)))
    if len(table) < 2:
        raise Problem(f"{path}: {len(table)} rows; a recording has two at least")
    columns = dict(zip(names, table.T, strict=True))
    times = columns[TIME] - columns[TIME][0]
    poses = np.stack([columns[name] for name in POSE], axis=1)
    poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1)[:, None]
    buttons = {name: columns[name] for name in names if name not in (TIME, GRIPPER, *POSE)}
    return Recording(times, poses, columns.get(GRIPPER), buttons)


def _rows(path: Path, lines: Iterator[tuple[int, str]], names: list[str]) -> Iterator[list[float]]:
    last, places = -math.inf, [names.index(name) for name in POSE]
    time = names.index(TIME)
    for number, line in lines:
        try:
            values = [float(word) for word in next(csv.reader([line]))]
        except ValueError as error:
            raise Problem(f"{path}:{number}: {error}") from None
        if len(values) != len(names) or not all(math.isfinite(value) for value in values):
            raise Problem(f"{path}:{number}: {len(values)} values; needed are {len(names)} finite numbers")
        try:
            normalised(np.array([values[place] for place in places]))
        except PoseError as error:
            raise Problem(f"{path}:{number}: {error}") from None
        if not values[time] > last:
            raise Problem(f"{path}:{number}: {TIME} {values[time]:g} does not come after {last:g}")
        last = values[time]
        yield values


def _between(first: Array, second: Array, part: float) -> Array:
    """The orientation that far on the way; quaternions (4,) of length 1."""
    cosine = float(first.dot(second))
    near = second if cosine >= 0.0 else -second  # the shorter way round
    angle = math.acos(min(1.0, abs(cosine)))
    if angle < 1e-6:
        return first
    mixed = (math.sin((1.0 - part) * angle) * first + math.sin(part * angle) * near) / math.sin(angle)
    return np.asarray(mixed / np.linalg.norm(mixed))
