"""Digital inputs of all boards: extracted from the blocks, debounced, reported as events."""

from __future__ import annotations

from typing import Final

import numpy as np

from trocar.procs.fpga import blocks
from trocar.procs.io.reports import IoEvent
from trocar.procs.io.robots import IoData
from trocar.procs.node.debounce import NAMES, Debounce

PAYLOADS: Final = (0.0, 1.0, 2.0)  # as in CRTK's button events: pressed, released, clicked


class Buttons:
    """The inputs of one io in the order of the document."""

    def __init__(self, data: IoData) -> None:
        """Reads the port's `blocks`."""
        robots, port, inputs = data.robots, data.port, data.robots.io.digital_inputs
        self._names = [i.name for i in inputs]
        self.count = len(inputs)
        self._flat = port.blocks.reshape(-1)
        self.index = np.array(
            [robots.row_of[i.board_id] * port.columns.count + blocks.DIGITAL_INPUT for i in inputs], dtype=np.intp)
        self.bit = np.array([1 << i.bit_id for i in inputs], dtype=np.uint32)
        self.debounce = Debounce(inputs)
        self._record, self._reports = data.record, data.reports

    def watch(self) -> bool:
        """Take the bits of the newest sample; True: call `settle`."""
        if not self._names:
            return False
        return self.debounce.watch(self._flat.take(self.index) & self.bit != 0)

    def settle(self, dt_s: float) -> None:
        """Process changed bits, `dt_s` after the previous sample."""
        for index, kind in self.debounce.settle(dt_s):
            name = self._names[index]
            self._reports.events.append(IoEvent("button", NAMES[kind], NAMES[kind], name, value=PAYLOADS[kind]))
        self._record.input[...] = self.debounce.value
