"""Joint setpoints from a CSV file: positions, then velocities, then efforts of all joints in each row."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from trocar.tools.output.errors import Problem

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Setpoints:
    """Rows to follow: positions (k, n) and velocities (k, n) or None, the jaw's positions (k,) or None; rad, m."""

    position: Array
    velocity: Array | None
    jaw: Array | None

    def __len__(self) -> int:
        return len(self.position)


@dataclass(frozen=True, slots=True)
class ClippedRows:
    """What was cut to a range: rows touched, and by how much at most (rad or m)."""

    rows: int
    most: float


def read_setpoints(path: Path, joints: int, has_jaw: bool) -> Setpoints:
    """Setpoints for an arm of `joints` joints, with a jaw column behind them where the arm has a jaw.

    Columns are one, two or three blocks (positions, velocities, efforts) of as many columns; a header is skipped.
    """
    table = _table(path)
    columns = table.shape[1]
    for width in (joints + 1, joints) if has_jaw else (joints, joints + 1):
        if columns in (width, 2 * width, 3 * width):
            position, rest = table[:, :width], table[:, width : 2 * width]
            velocity = rest[:, :joints] if columns >= 2 * width else None
            return Setpoints(position[:, :joints], velocity, position[:, joints] if width > joints else None)
    blocks = " or ".join(str(joints * k) for k in (1, 2, 3))
    with_jaw = f" (or {', '.join(str((joints + 1) * k) for k in (1, 2, 3))} with the jaw)"
    raise Problem(f"{path}: {columns} columns; for {joints} joints they must be {blocks}{with_jaw}")


def _table(path: Path) -> Array:
    rows: list[list[float]] = []
    try:
        with path.open(encoding="utf-8", newline="") as file:
            for number, words in enumerate(csv.reader(file), 1):
                if not words or (number == 1 and not _is_number(words[0])):
                    continue
                rows.append(_numbers(path, number, words))
    except OSError as error:
        raise Problem(f"{path}: {error.strerror}") from None
    if not rows:
        raise Problem(f"{path}: there are no rows")
    widths = {len(row) for row in rows}
    if len(widths) > 1:
        raise Problem(f"{path}: rows have {min(widths)} to {max(widths)} columns; all must have the same number")
    return np.array(rows)


def _numbers(path: Path, number: int, words: list[str]) -> list[float]:
    try:
        row = [float(word) for word in words]
    except ValueError:
        raise Problem(f"{path}, line {number}: {','.join(words)[:60]!r} is not a row of numbers") from None
    if not np.isfinite(row).all():
        raise Problem(f"{path}, line {number}: the numbers must be finite")
    return row


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def clipped(values: Array, lower: float, upper: float) -> tuple[Array, ClippedRows]:
    """Values brought into [lower, upper], and what that took."""
    inside = np.clip(values, lower, upper)
    off = np.abs(values - inside)
    return inside, ClippedRows(int(np.count_nonzero(off)), float(off.max(initial=0.0)))
