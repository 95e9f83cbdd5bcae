"""Real-time samples of all boards of a bus, and the blocks of the wire taken from them.

A canonical row has a column for everything any board has: hub header, time stamp, status, digital inputs, temperatures,
then `width` columns each of ADC, positions, the four velocity words and motor status. A board sends a selection of its
row (`Model.columns`), so one gather makes the blocks of any mix of boards.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from trocar.procs.boards.controllers.lines import Quads
from trocar.procs.boards.controllers.models import BLOCK, HEAD, Model
from trocar.procs.fpga import blocks
from trocar.procs.fpga.blocks import KINDS, SCALARS

TEMPERATURES = 0x3C3E  # 30 and 31 °C


class BoardSamples:
    """Rows of the boards by ascending id; arrays (boards, …) named after their content."""

    def __init__(self, models: Sequence[Model], width: int) -> None:
        """No sample yet."""
        n = len(models)
        self._models, self._width = models, width
        self.rows: Quads = np.zeros((n, BLOCK + SCALARS + KINDS * width), dtype=np.uint32)
        self.head, block = self.rows[:, HEAD], self.rows[:, BLOCK:]
        self.stamps = block[:, blocks.TIMESTAMP]
        self.status, self.inputs = block[:, blocks.STATUS], block[:, blocks.DIGITAL_INPUT]
        self.temperatures = block[:, blocks.TEMPERATURE]  # and state of the data collection
        self.temperatures[:] = TEMPERATURES
        self.adc, self.positions, *_, self.motor_status = (
            block[:, SCALARS + kind * width : SCALARS + (kind + 1) * width] for kind in range(KINDS))
        self.first_encoder = BLOCK + SCALARS + width  # first column of the positions; velocity words follow them
        self.velocities = block[:, SCALARS + 2 * width : SCALARS + 6 * width].reshape(n, 4, width)
        assert np.shares_memory(self.velocities, self.rows)
        self._passed = np.zeros(n, dtype=np.int64)
        self.sampled = np.full(n, -1, dtype=np.int64)  # tick of every board's last sample, or that before it got power
        self._places = [row * self.rows.shape[1] + model.columns(width) for row, model in enumerate(models)]
        self._selections: dict[tuple[int, ...], npt.NDArray[np.intp]] = {}

    def stamp(self, rows: Sequence[int], tick: int) -> None:
        """Boards `rows` take a sample at `tick`: time since their last one, which restarts."""
        if len(rows) < len(self.sampled):
            for row in rows:
                self.stamps[row] = max(tick - 1 - int(self.sampled[row]), 0) & 0xFFFF_FFFF  # the counter wraps
                self.sampled[row] = tick
            return
        passed = np.subtract(tick - 1, self.sampled, self._passed)
        self.stamps[...] = np.maximum(passed, 0, out=passed)
        self.sampled.fill(tick)

    def power_up(self, row: int, tick: int) -> None:
        """The FPGA of a board is reconfigured: its time restarts here."""
        self.sampled[row] = tick - 1

    def selection(self, rows: tuple[int, ...]) -> npt.NDArray[np.intp]:
        """Positions of the hub blocks of boards `rows`, one after the other; for `take`."""
        found = self._selections.get(rows)
        if found is None:
            if len(self._selections) > len(self._models):  # memory stays bounded for any requests
                self._selections.clear()
            found = np.concatenate([self._places[row] for row in rows])
            self._selections[rows] = found
        return found

    def take(self, selection: npt.NDArray[np.intp], out: Quads) -> None:
        """The quadlets of a selection."""
        self.rows.take(selection, None, out, "clip")

    def block(self, row: int) -> bytes:
        """The real-time block of a board in wire format."""
        return bytes(self.rows.take(self._places[row][BLOCK:]).astype(">u4"))
