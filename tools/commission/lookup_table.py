"""The table of a digital potentiometer from motions by hand: the joint position at each of its 4096 readings.

Encoders measure motions only, from wherever they began. The table's middle is therefore that of the mechanical range,
which is the same for all arms of a type.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.fpga.lookup import ENTRIES

Floats = NDArray[np.float64]

MISSING: Final = 31.4159
"""What files write where the potentiometer has no position."""
RANGE_WITHIN: Final = 0.05
MAX_GAP, PADDED = 20, 50
"""Readings that may be missing between two others; readings beyond each end that get its position."""
MAX_SPREAD: Final = 5.0
"""Steps by which positions at one reading may differ, back and forth."""
DIGITS: Final = 9
RANGES: Final[dict[str, tuple[tuple[float, float], ...]]] = {
    "PSM": ((-2.966300, 2.966300), (-1.266133, 1.301533), (-0.000990837, 0.290430), (-3.030967, 3.030967),
            (-3.030000, 3.030000), (-3.031567, 3.031567), (-3.031533, 3.031533)),
    "ECM": ((-2.966850, 2.966850), (-1.115700, 1.052150), (0.001, 0.259220), (-1.542400, 1.542400))}
"""Mechanical ranges, rad or m, in the manufacturer's sense."""
SENSES: Final[dict[str, tuple[int, ...]]] = {"PSM": (1, -1, 1, -1, -1, -1, 1), "ECM": (1, -1, 1, -1)}
"""Sign of the manufacturer's sense against the encoder's."""


class ReadingsByHand:
    """Encoder positions at the readings of each axis, while a person moves the arm."""

    def __init__(self, axes: int) -> None:
        """Nothing was read yet."""
        self._row = np.arange(axes)[:, None]
        self._sum, self.count = np.zeros((axes, ENTRIES)), np.zeros((axes, ENTRIES), dtype=np.int64)
        self._low, self._high = np.full((axes, ENTRIES), np.inf), np.full((axes, ENTRIES), -np.inf)

    def add(self, readings: NDArray[np.integer], positions: Floats, axes: Sequence[int] | None = None) -> None:
        """Samples (k, axes); only those of some `axes` count."""
        some = slice(None) if axes is None else list(axes)
        codes, values = readings.T[some], positions.T[some]
        where = np.broadcast_to(self._row[some], codes.shape), codes
        np.add.at(self._sum, where, values)
        np.add.at(self.count, where, 1)
        np.minimum.at(self._low, where, values)
        np.maximum.at(self._high, where, values)

    def forget(self, axis: int) -> None:
        """Nothing of this axis was read yet."""
        self._sum[axis], self.count[axis], self._low[axis], self._high[axis] = 0.0, 0, np.inf, -np.inf

    def range(self) -> Floats:
        """Widths (axes,) of the positions so far; 0 before the first sample."""
        found: Floats = np.maximum(self._high.max(axis=1) - self._low.min(axis=1), 0.0)
        return found

    def row(self, axis: int, kind: str) -> tuple[Floats, str]:
        """The table (4096,) of an axis of a PSM or an ECM, and why it is none; "": it is one."""
        count = self.count[axis]
        seen = np.flatnonzero(count)
        if seen.size < 2:
            return np.zeros(0), "its potentiometer shows one reading only"
        gaps = np.diff(seen, append=seen[0] + ENTRIES) - 1  # on the ring of readings, behind each that was seen
        widest = int(np.argmax(gaps))
        ordered = np.roll(seen, -widest - 1)  # begins behind the part without positions
        steps = (ordered - ordered[0]) % ENTRIES
        inner = np.delete(gaps, widest)
        if inner.max() > MAX_GAP:
            return np.zeros(0), f"{inner.max()} readings in a row are missing"
        means = self._sum[axis][ordered] / count[ordered]
        low, high = RANGES[kind][axis]
        spread = float((self._high[axis] - self._low[axis])[ordered].max())  # first: means of other axes' positions lie
        if not spread <= MAX_SPREAD * (high - low) / (int(steps[-1]) + 1):
            return np.zeros(0), f"positions at one reading differ by {spread:.4g}"
        width = float(means.max() - means.min())
        if not abs(width / (high - low) - 1.0) <= RANGE_WITHIN:
            return np.zeros(0), f"its range is {width:.4g}"
        middle = SENSES[kind][axis] * 0.5 * (low + high)
        filled = np.interp(np.arange(steps[-1] + 1), steps, means) + middle - 0.5 * (means.max() + means.min())
        table = np.full(ENTRIES, MISSING)
        free = ENTRIES - len(filled)
        before, after = free // 2 if free < 2 * PADDED else PADDED, min(PADDED, free - free // 2)
        for first, values in ((ordered[0], filled), (ordered[0] - before, np.full(before, filled[0])),
                              (ordered[0] + len(filled), np.full(after, filled[-1]))):
            table[(first + np.arange(len(values))) % ENTRIES] = values
        return table, ""
