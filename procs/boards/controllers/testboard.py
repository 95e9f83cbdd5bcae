"""The loop-back test board of the original test programs on one QLA: its digital outputs drive its inputs.

Pins: output 1 drives line A of all four encoders, output 2 line B, output 3 the index, output 4 all limit and home
inputs. The analog inputs are at one voltage, and the commanded current flows.
"""

from __future__ import annotations

from typing import Final

import numpy as np
import numpy.typing as npt

from trocar.procs.boards.controllers.lines import Quads
from trocar.procs.boards.controllers.quadrature import Quadrature
from trocar.procs.boards.devices.outputs import MAX_CHANGES, BoardOutputs
from trocar.procs.document.system import Quirks
from trocar.procs.fpga import registers as reg

FEW_CHANGES: Final = 64  # between two looks, 1 ms apart at most
_POTS: Final = np.uint32(0x8000 << 16)  # the analog inputs are at 2.25 V of 4.5 V
_EVERY_AXIS: Final = (1 << reg.AXES) - 1
_ALL_SWITCHES: Final = 0xFFF  # negative limits, positive limits, home
_FAITHFUL: Final = Quirks()


class Loopback:
    """A test board. `until` must be called before each write to the outputs, with the tick of the write."""

    def __init__(self, outputs: BoardOutputs, *, first: int = 0, quirks: Quirks = _FAITHFUL) -> None:
        """As after power-up of the board at tick 0; `first` is 4 on the second QLA of a DQLA."""
        self._first, self._quirks = first, quirks
        self.power_up(outputs, 0)

    def power_up(self, outputs: BoardOutputs, tick: int) -> None:
        """The FPGA is reconfigured and has new outputs."""
        self._outputs, self._at = outputs, tick
        self._levels = outputs.levels(tick)
        self._encoder = Quadrature(tick, *self._lines(self._levels), reg.AXES, self._quirks)

    def _lines(self, levels: int) -> tuple[int, int]:
        """Lines A and B: pins are the inverse of the register."""
        pins = ~levels >> self._first
        return pins & 1, pins >> 1 & 1

    def until(self, tick: int) -> None:
        """Let the outputs drive the encoders up to `tick`."""
        outputs = self._outputs
        if outputs.busy_until > self._at:
            # A table is processed completely; for outputs that keep switching, such as PWM, the newest changes suffice.
            once = outputs.plays_once
            changes = outputs.changes(self._at, tick, MAX_CHANGES if once else FEW_CHANGES)
            self._drive(changes.since, changes.levels)
            for at, levels in changes.items:
                self._drive(at, levels)
        else:  # only a write, and that arrived at the tick of the last call
            self._drive(self._at, outputs.levels(tick))
        self._at = tick
        self._encoder.observe(tick)

    def _drive(self, tick: int, levels: int) -> None:
        if levels != self._levels:
            self._levels = levels
            self._encoder.change(tick, *self._lines(levels))

    def preload(self, axis: int, value: int, tick: int) -> None:
        """The preload register of an axis is written."""
        self.until(tick)
        self._encoder.load(axis, value & reg.ENCODER_MASK)

    def fill(self, tick: int, positions: Quads, velocities: Quads) -> int:
        """Put the words of the four axes at `tick` into `positions` (4,) and `velocities` (4, 4: word, axis).

        Returns the bits of the digital inputs: A, B, index, limits and home, without those that the board itself sets
        (levels of the outputs, whether the waveform is played).
        """
        self.until(tick)
        a, b = self._lines(self._levels)
        pins = ~self._levels >> self._first
        index, switches = pins >> 2 & 1, pins >> 3 & 1
        positions[:] = [self._encoder.position(axis) | index * reg.ENCODER_PIN_INDEX for axis in range(reg.AXES)]
        velocities.T[:] = self._encoder.velocity(tick)
        return (a * _EVERY_AXIS << reg.INPUT_ENCODER_A_SHIFT | b * _EVERY_AXIS << reg.INPUT_ENCODER_B_SHIFT
                | index * _EVERY_AXIS << reg.INPUT_ENCODER_INDEX_SHIFT | switches * _ALL_SWITCHES)

    def adc(self, dac: Quads, on: npt.NDArray[np.bool_]) -> Quads:
        """ADC words (4,) while commands are `dac` and the amplifiers that are `on` follow them."""
        return _POTS | np.where(on, dac, np.uint32(reg.CURRENT_ZERO)).astype(np.uint32)
