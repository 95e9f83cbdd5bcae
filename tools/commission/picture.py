"""An arm's pose as a picture of characters."""

from __future__ import annotations

from typing import Final

import numpy as np

from trocar.procs.kinematics.forward import Kinematics
from trocar.tools.commission.window import Floats

TOP: Final = ((0, 1, "from above: x to the right, y up"),)
SIDES: Final = ((0, 2, "along y of its base: x to the right, z up"),
               (1, 2, "along x of its base: y to the right, z up"))
WIDTH, HEIGHT = 48, 11
TALL: Final = 2.0  # a character is so much higher than wide
STEPS: Final = 60  # of a line


def picture(points: Floats, views: tuple[tuple[int, int, str], ...]) -> str:
    """Each view, below the other: the base `#`, joints `o`, the tip `x`; `points` (k, 3) are theirs, m."""
    return "\n".join(line for across, up, text in views
                     for line in (text, *_view(points[:, across], points[:, up]), ""))


def frames_at(kinematics: Kinematics, q: Floats) -> Floats:
    """Where base, joints and tip (k, 3) are at these joints, in the frame of the base, m."""
    frames = np.array(kinematics.links.frames(q.tolist())).reshape(-1, 3, 4)
    found: Floats = np.vstack([np.zeros(3), frames[:, :, 3], kinematics.fk(q)[:3, 3]])
    return found


def _view(across: Floats, up: Floats) -> list[str]:
    cell = max(np.ptp(across) / (WIDTH - 1), np.ptp(up) / (TALL * (HEIGHT - 1)), 1e-6)
    columns, rows = (across - across.min()) / cell, (up.max() - up) / (TALL * cell)
    canvas = np.full((round(float(rows.max())) + 1, round(float(columns.max())) + 1), " ")
    for begin in range(len(across) - 1):
        for share in np.linspace(0.0, 1.0, STEPS):
            row, column = (line[begin] + share * (line[begin + 1] - line[begin]) for line in (rows, columns))
            canvas[round(float(row)), round(float(column))] = "·"
    for row, column, mark in (*zip(rows, columns, "o" * len(rows), strict=True), (rows[-1], columns[-1], "x"),
                              (rows[0], columns[0], "#")):
        canvas[round(float(row)), round(float(column))] = mark
    return [f"    {''.join(row).rstrip()}" for row in canvas]
