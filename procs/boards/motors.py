"""Motor command words and motor configuration of all boards of a bus."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from procs.boards.board import Board
from procs.boards.lines import Lines
from procs.boards.models import Model
from procs.boards.power import Power
from procs.lib import registers as reg

Quads = npt.NDArray[np.uint32]


class Motors:
    """Arrays (boards, width); commands go to `lines.dac`, enables to `power`."""

    def __init__(self, models: Sequence[Model], lines: Lines, power: Power, boards: Sequence[Board]) -> None:
        """As after power-up."""
        self._models, self._lines, self._power, self._boards = models, lines, power, boards
        shape = lines.dac.shape
        self.config = np.full(shape, reg.MOTOR_CONFIG_POWER_UP, dtype=np.uint32)
        self.unchecked = np.zeros(shape, dtype=np.bool_)
        self._no_control = np.zeros(shape[0], dtype=np.uint32)
        self._top = np.zeros(shape, dtype=np.uint32)  # top byte of the last command words
        self._last_top = b""
        self._top_shift, self._dac_mask = (np.full(shape, k, dtype=np.uint32) for k in (24, reg.DAC_VALUE_MASK))
        self._accept = np.zeros(shape, dtype=np.bool_)
        self._settled = -1
        self._values = np.zeros(shape, dtype=np.uint32)

    def execute(self, words: Quads, control: Quads, tick: int) -> None:
        """Motor command words (boards, width), then control words (boards,); all 0 for boards not addressed.

        A word of zeros changes nothing: without a mask bit an enable stays, and it is never left on where power or a
        latch forbids it.
        """
        power = self._power
        top, busy = np.right_shift(words, self._top_shift, self._top), power.heeds(control)
        enables = top.tobytes()
        if busy or self._settled != power.changes or enables != self._last_top:
            # The same enables on the same state change nothing; this is what a running host sends every cycle.
            power.enable((top & 0x20) != 0, (top & 0x10) != 0, tick)
            self._settled = power.changes
            if busy:  # counts as a change: the same enables may mean something else with power on
                power.control(control & np.uint32(reg.CONTROL_REAL_TIME_BITS), tick)
            self._last_top = enables
            self._accept = (top & 0x8F) == 0x80  # valid, current mode; there is no expander for voltage mode
        np.bitwise_and(words, self._dac_mask, self._values)
        np.copyto(self._lines.dac, self._values, where=self._accept)

    def write(self, row: int, axis: int, offset: int, value: int, tick: int) -> None:
        """Write of an axis register that belongs here: command or configuration."""
        if offset == reg.DAC:
            words = np.zeros(self.config.shape, dtype=np.uint32)
            words[row, axis] = value
            self.execute(words, self._no_control, tick)
        elif offset == reg.MOTOR_CONFIG:
            self._configure(row, axis, value)

    def read(self, row: int, axis: int, offset: int) -> int:
        """Value of an axis register that belongs here."""
        if offset == reg.DAC:
            return int(self._lines.dac[row, axis])
        return int(self.config[row, axis]) if offset == reg.MOTOR_CONFIG else 0

    def control(self, row: int, value: int, tick: int) -> None:
        """The control register of a board is written."""
        control = self._no_control.copy()
        control[row] = value & reg.CONTROL_REAL_TIME_BITS
        self._power.control(control, tick)

    def check_currents(self, tick: int) -> None:
        """Currents and commands as they are hold from `tick` on: compare them."""
        measured = self._lines.adc.astype(np.int64) & 0xFFFF
        self._power.check_currents(tick, self._lines.dac.astype(np.int64), measured, self.unchecked)

    def power_up(self, row: int) -> None:
        """The FPGA of a board is configured anew."""
        self._lines.dac[row] = reg.CURRENT_ZERO
        self.config[row] = reg.MOTOR_CONFIG_POWER_UP
        self.unchecked[row] = False

    def _configure(self, row: int, axis: int, value: int) -> None:
        """Motor configuration: bits 31 and 30 always, delay and current limit where their set bit is 1."""
        old = int(self.config[row, axis])
        delay = value if value & 1 << 25 else old
        limit = value if value & 1 << 24 else old
        self.config[row, axis] = value & 0xC000_0000 | 1 << 24 | delay & 0x00FF_0000 | limit & 0x7FFF
        self.unchecked[row, axis] = bool(value & reg.MOTOR_CONFIG_NO_SAFETY_CHECK)
