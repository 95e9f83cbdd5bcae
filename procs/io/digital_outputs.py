"""Digital outputs of the boards: levels, one-shots and PWM.

A register holds inverted levels (1 is a low pin); all levels here are those of pins. A write names its outputs, so two
writes in one cycle do not undo each other. A dRA1 does not show its output: the last value written counts.

Outputs that io sets by itself are kept: written three times, and again whenever the board shows another level.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from trocar.procs.document.system import DigitalOutput
from trocar.procs.fpga import blocks, registers
from trocar.procs.io.bus.transport import PortError
from trocar.procs.io.record import Flags
from trocar.procs.io.robots import IoData

MAX_COUNTS: Final = 0xFFFF
TURN_TICKS: Final = 2  # an output switches this many ticks after its count ends
MIN_PWM_HZ: Final = 375.0
MASK_SHIFT: Final = 8
QLA_OUTPUTS: Final = 4
WRITES: Final = 3  # of each change: a datagram may be lost


@dataclass(slots=True)
class Kept:
    """Required value of an output: low 0, high 1, or the duty cycle of a PWM; and the writes still to do."""

    value: float
    writes: int = WRITES
    failed: bool = False


class DigitalOutputs:
    """The outputs of one io in the order of the document."""

    def __init__(self, data: IoData) -> None:
        """Sets up the one-shots."""
        robots, port = data.robots, data.port
        self._robots, self._port = robots, port
        self._outputs, self._record, self._reports = robots.io.digital_outputs, data.record, data.reports
        self._kept = dict[int, Kept]()
        row = robots.row_of
        self._flat = port.blocks.reshape(-1)
        self.index = np.array([row[o.board_id] * port.columns.count + blocks.DIGITAL_INPUT for o in self._outputs],
                               dtype=np.intp)
        self.bit = np.array([_shown(o.bit_id) for o in self._outputs], dtype=np.uint32)
        self.unseen: Flags = np.array([port.hardware[row[o.board_id]] == "dRA1" for o in self._outputs], dtype=bool)
        self.written: Flags = np.zeros(len(self._outputs), dtype=bool)
        self.names, self.count = tuple(o.name for o in self._outputs), len(self._outputs)
        for place in range(self.count):
            self._set_up(place)

    def _set_up(self, place: int) -> None:
        output = self._outputs[place]
        if not output.is_pwm and (output.high_s or output.low_s):
            for _ in range(WRITES):
                self._configure(output, _counts(output.high_s), _counts(output.low_s))

    def restore(self, rows: Flags) -> None:
        """These boards (by row) may be as after power-up: write the kept values there again."""
        for place, output in enumerate(self._outputs):
            if rows[self._robots.row_of[output.board_id]]:
                self._set_up(place)
                if place in self._kept:
                    self._kept[place].writes = WRITES

    def place(self, name: str, command: str, robot: str) -> int | None:
        """The index of the output with this name, if this command to this robot sets it."""
        return next((place for place, row in enumerate(self._outputs)
                     if (row.name, row.set_by, row.robot) == (name, command, robot)), None)

    def owner(self, place: int) -> str:
        """The command and robot that set an output; empty: `set_output` or `set_pwm` does."""
        row = self._outputs[place]
        return f"{row.set_by} {row.robot}" if row.set_by else ""

    def keep(self, place: int, value: float) -> None:
        """Set the required value of an output; see `step`."""
        kept = self._kept.get(place)
        if kept is None or kept.value != value:
            self._kept[place] = Kept(value)

    def step(self) -> None:
        """Once a cycle, after `show`: write the outputs that differ from their required values."""
        for place, kept in self._kept.items():
            if kept.writes:
                kept.writes -= self._send(place, kept)
            elif not self._outputs[place].is_pwm and self._record.output[place] != kept.value:
                kept.writes = 1  # in the next cycle, after its sample shows the result

    def shutdown(self) -> None:
        """Write all kept values again, WRITES times each."""
        for place, kept in self._kept.items():
            for _ in range(WRITES):
                self._send(place, kept)

    def _send(self, place: int, kept: Kept) -> bool:
        """Write the value; returns whether it was sent."""
        try:
            if self._outputs[place].is_pwm:
                self._set_pwm(place, kept.value)
            else:
                self._set(place, kept.value > 0.5)
        except PortError as error:
            if not kept.failed:
                self._reports.status(f"{self.names[place]}: {error}", self._outputs[place].robot)
            kept.failed = True
            return False
        kept.failed = False
        return True

    def set(self, place: int, high: bool) -> None:
        """Set a level; a one-shot keeps it for the time in the file."""
        if place in self._kept:
            self.keep(place, float(high))
        self._set(place, high)

    def _set(self, place: int, high: bool) -> None:
        output = self._outputs[place]
        if output.is_pwm:
            self._configure(output, 0, 0)
        self._write(output, high)
        self.written[place] = high

    def set_pwm(self, place: int, duty: float) -> str:
        """Set the share of time high, 0 to 1, at the file's frequency. Returns the reason for a refusal, or ""."""
        reason = self.pwm_objection(place, duty)
        if not reason:
            if place in self._kept:
                self.keep(place, duty)
            self._set_pwm(place, duty)
        return reason

    def pwm_objection(self, place: int, duty: float) -> str:
        """Why an output cannot have this duty cycle, or ""."""
        output = self._outputs[place]
        if not output.is_pwm:
            return "the file does not declare it as a PWM output"
        if not output.pwm_hz > MIN_PWM_HZ:
            return f"its PWM_frequency is {output.pwm_hz} Hz; allowed: above {MIN_PWM_HZ:g}"
        return "" if 0.0 <= duty <= 1.0 else f"duty {duty}; allowed: 0 to 1"

    def _set_pwm(self, place: int, duty: float) -> None:
        output = self._outputs[place]
        high, low = (round(share * registers.CLOCK_HZ / output.pwm_hz) - TURN_TICKS for share in (duty, 1.0 - duty))
        if high < 1 or low < 1:  # too short to switch at all
            self._set(place, duty > 0.5)
        else:
            self._configure(output, high, low)
            self._write(output, True)

    def show(self) -> None:
        """Show the levels of the newest sample."""
        if self.names:
            np.equal(self._flat.take(self.index) & self.bit, 0, self._record.output)
            np.copyto(self._record.output, self.written, where=self.unseen)

    def _configure(self, output: DigitalOutput, high: int, low: int) -> None:
        """Ticks that a pin stays high and low; 0: until the next write."""
        address = registers.axis_register(output.bit_id, registers.PWM)
        self._port.write_quadlet(output.board_id, address, low << 16 | high)

    def _write(self, output: DigitalOutput, high: bool) -> None:
        bit = 1 << output.bit_id
        self._port.write_quadlet(output.board_id, registers.DIGITAL_OUTPUT, bit << MASK_SHIFT | (0 if high else bit))


def _counts(seconds: float) -> int:
    """Count of a one-shot, at most the 1.33 ms that fit."""
    return min(round(seconds * registers.CLOCK_HZ), MAX_COUNTS)


def _shown(bit: int) -> int:
    """The bit of the digital input word that shows an output; the second QLA of a DQLA has its own bits."""
    if bit < QLA_OUTPUTS:
        return 1 << registers.INPUT_DOUT_SHIFT + bit
    return 1 << registers.INPUT_DOUT_FAR_SHIFT + bit - QLA_OUTPUTS
