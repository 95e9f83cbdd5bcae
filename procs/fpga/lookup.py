"""Tables of digital potentiometers: the position at each of 4096 readings, for every actuator of a robot.

In the document a table is text (base64 of doubles in this machine's format), for fast transfer and decoding. Readings
without a position are NaN.
"""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

ENTRIES: Final = 4096
MISSING_ABOVE: Final = 31.0  # rad or m: files write 31.4159 where the potentiometer has no position

Floats = NDArray[np.float64]


def pack(rows: Sequence[Sequence[float]]) -> str:
    """The table as text; ValueError names the first row that does not have 4096 numbers."""
    table = np.zeros((len(rows), ENTRIES))
    for number, row in enumerate(rows):
        if len(row) != ENTRIES or not all(isinstance(x, int | float) and math.isfinite(x) for x in row):
            raise ValueError(f"lookup[{number}]: {len(row)} entries; allowed: {ENTRIES} finite numbers")
        table[number] = row
    table[table > MISSING_ABOVE] = np.nan
    return base64.b64encode(table.tobytes()).decode("ascii")


def unpack(text: str, actuators: int) -> Floats:
    """The table (actuators, 4096); ValueError if the text is not a table."""
    data = base64.b64decode(text.encode("ascii"), validate=True)
    if len(data) != actuators * ENTRIES * 8:
        raise ValueError(f"potentiometer table of {len(data)} bytes; wanted: {actuators * ENTRIES * 8}")
    return np.frombuffer(data, np.float64).reshape(actuators, ENTRIES)


class InverseLookup:
    """From positions to readings, like real potentiometers: the nearest entry, on a fine grid."""

    GRID: Final = 1 << 14  # finer than the tables

    def __init__(self, table: Floats) -> None:
        """`table` (n, 4096). A row without positions always reads 0."""
        n = len(table)
        self._low, self._per_unit = np.zeros(n), np.zeros(n)
        self._readings = np.zeros((n, self.GRID), dtype=np.uint16)
        for row, positions in enumerate(table):
            known = np.flatnonzero(~np.isnan(positions))
            if not known.size:
                continue
            order = known[np.argsort(positions[known], kind="stable")]
            values = positions[order]
            low, high = values[0], values[-1]
            grid = np.linspace(low, high, self.GRID)
            last = len(values) - 1
            after = np.clip(np.searchsorted(values, grid), min(1, last), last)
            before = np.maximum(after - 1, 0)
            nearer = grid - values[before] <= values[after] - grid
            self._readings[row] = order[np.where(nearer, before, after)]
            self._low[row] = low
            self._per_unit[row] = (self.GRID - 1) / (high - low) if high > low else 0.0
        self._rows = np.arange(n) * self.GRID
        self._flat = self._readings.reshape(-1)

    def readings(self, position: Floats) -> NDArray[np.uint16]:
        """Readings (n,) at positions (n,); beyond a table's ends, the readings at the ends."""
        places = np.rint((position - self._low) * self._per_unit)
        cell = np.minimum(np.fmax(places, 0.0), self.GRID - 1).astype(np.intp)  # NaN: 0
        found: NDArray[np.uint16] = self._flat[self._rows + cell]
        return found
