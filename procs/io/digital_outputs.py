"""Digital outputs of the boards: levels, one-shots and PWM.

A register holds the pins' levels upside down (1 is a low pin); whoever asks here means pins. A write names the outputs
it is about, so two in one cycle do not undo each other. A dRA1 does not show its output: what was written last counts.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from procs.document.system import DigitalOutput
from procs.fpga import blocks, registers
from procs.io.bus.port import Port
from procs.io.record import Flags, IoRecord
from procs.io.robots import Robots

MAX_COUNTS: Final = 0xFFFF
TURN_TICKS: Final = 2  # an output turns so many ticks after its count is over
MIN_PWM_HZ: Final = 375.0
MASK_SHIFT: Final = 8
QLA_OUTPUTS: Final = 4


class DigitalOutputs:
    """The outputs of one io in the order of the document."""

    def __init__(self, robots: Robots, port: Port, record: IoRecord) -> None:
        """Sets up the one-shots; the boards of `port` are discovered."""
        self._outputs, self._port, self._record = robots.io.digital_outputs, port, record
        row = {board: k for k, board in enumerate(robots.board_ids)}
        self._flat = port.blocks.reshape(-1)
        self.index = np.array([row[o.board_id] * port.columns.count + blocks.DIGITAL_INPUT for o in self._outputs],
                               dtype=np.intp)
        self.bit = np.array([_shown(o.bit_id) for o in self._outputs], dtype=np.uint32)
        self.unseen: Flags = np.array([port.hardware[row[o.board_id]] == "dRA1" for o in self._outputs], dtype=bool)
        self.written: Flags = np.zeros(len(self._outputs), dtype=bool)
        self._words: NDArray[np.uint32] = np.zeros(len(self._outputs), dtype=np.uint32)
        self.names, self.count = tuple(o.name for o in self._outputs), len(self._outputs)
        for output in self._outputs:
            if not output.is_pwm and (output.high_s or output.low_s):
                self._configure(output, _counts(output.high_s), _counts(output.low_s))

    def set(self, place: int, high: bool) -> None:
        """A level; of a one-shot it lasts as long as the file says."""
        output = self._outputs[place]
        if output.is_pwm:
            self._configure(output, 0, 0)
        self._write(output, high)
        self.written[place] = high

    def set_pwm(self, place: int, duty: float) -> str:
        """A share of the time high, 0 to 1, at the file's frequency. Returns why not, or ""."""
        output = self._outputs[place]
        if not output.is_pwm:
            return "the file does not call it a PWM"
        if not output.pwm_hz > MIN_PWM_HZ:
            return f"its PWM_frequency is {output.pwm_hz} Hz; allowed: above {MIN_PWM_HZ:g}"
        if not 0.0 <= duty <= 1.0:
            return f"duty {duty}; allowed: 0 to 1"
        high, low = (round(share * registers.CLOCK_HZ / output.pwm_hz) - TURN_TICKS for share in (duty, 1.0 - duty))
        if high < 1 or low < 1:  # too short to turn at all
            self.set(place, duty > 0.5)
        else:
            self._configure(output, high, low)
            self._write(output, True)
        return ""

    def show(self) -> None:
        """Show the levels of the newest sample."""
        if self.names:
            self._flat.take(self.index, out=self._words, mode="clip")
            np.bitwise_and(self._words, self.bit, self._words)
            np.equal(self._words, 0, self._record.output)
            np.copyto(self._record.output, self.written, where=self.unseen)

    def _configure(self, output: DigitalOutput, high: int, low: int) -> None:
        """Ticks that a pin stays high and low; 0: until it is written."""
        address = registers.axis_register(output.bit_id, registers.PWM)
        self._port.write_quadlet(output.board_id, address, low << 16 | high)

    def _write(self, output: DigitalOutput, high: bool) -> None:
        bit = 1 << output.bit_id
        self._port.write_quadlet(output.board_id, registers.DIGITAL_OUTPUT, bit << MASK_SHIFT | (0 if high else bit))


def _counts(seconds: float) -> int:
    """Count of a one-shot, at most the 1.33 ms that fit."""
    return min(round(seconds * registers.CLOCK_HZ), MAX_COUNTS)


def _shown(bit: int) -> int:
    """The bit of the digital input word that shows an output; the second QLA of a DQLA has its own place."""
    if bit < QLA_OUTPUTS:
        return 1 << registers.INPUT_DOUT_SHIFT + bit
    return 1 << registers.INPUT_DOUT_FAR_SHIFT + bit - QLA_OUTPUTS
