"""Differences of controllers other than a QLA1 in their real-time blocks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from trocar.procs.boards.controllers.lines import Lines, Quads
from trocar.procs.boards.controllers.models import Model
from trocar.procs.boards.controllers.motors import Motors
from trocar.procs.boards.controllers.power import BoardPower
from trocar.procs.boards.controllers.samples import BoardSamples
from trocar.procs.fpga import registers as reg

TEMPERATURES_DQLA = 0x3C3E_3C3E  # 30 and 31 °C at both QLAs
ESPM_CLOCKS, OUR_CLOCKS = 625, 384  # the ESPM measures periods with 80 MHz
_OWN_INPUTS, _FAR_INPUTS = 0x0FFF, 0x0FFF_0000  # of a DQLA's first and second QLA
_POT_BITS = 0xFFF
_NO_POT = 0xCCCC_0000  # motors of a dRA1 without one


class Differences:
    """For the boards of one bus; `there` tells whether there are any."""

    def __init__(self, models: Sequence[Model], lines: Lines, power: BoardPower, motors: Motors,
                 samples: BoardSamples) -> None:
        """Sets the temperatures to the values that these controllers measure."""
        self._lines, self._power, self._motors, self._samples = lines, power, motors, samples
        traits = power.traits
        self._dual, self._digital = (np.flatnonzero(flags) for flags in (traits.dual, traits.digital))
        self.there = bool(self._dual.size or self._digital.size)
        self.playing = np.zeros(len(models), dtype=np.bool_)  # DQLA: waveforms
        samples.temperatures[self._dual] = TEMPERATURES_DQLA
        samples.temperatures[self._digital] = 0  # it has no sensors
        self._potless = slice(max((model.hardware.encoders for model in models), default=0), lines.dac.shape[1])

    def show(self, outputs: Quads) -> None:
        """Correct the latest sample, made as if all were plain; `outputs` (boards,) are among the inputs."""
        if self._dual.size:
            self._of_dqla(self._dual, outputs)
        if self._digital.size:
            self._of_dra(self._digital)

    def _of_dqla(self, rows: npt.NDArray[np.intp], outputs: Quads) -> None:
        """No encoder lines among the inputs, but those of the second QLA."""
        samples = self._samples
        samples.inputs[rows] = (samples.inputs[rows] & _OWN_INPUTS | self._lines.inputs[rows] & _FAR_INPUTS
                                | outputs[rows])
        first, second = (self._motors.comparators()[rows, k] for k in (0, 1))
        lower = (first | second << 1) * np.uint32(reg.STATUS_DQLA_MOTOR_SUPPLY)
        lower |= self.playing[rows] * np.uint32(reg.STATUS_DQLA_WAVEFORM_ACTIVE)
        samples.status[rows] = self._power.status[rows] | lower

    def _of_dra(self, rows: npt.NDArray[np.intp]) -> None:
        """All joint data comes from the ESPM in the arm."""
        samples = self._samples
        samples.inputs[rows] = self._lines.inputs[rows]
        samples.motor_status[rows] = self._power.motor_flags[rows] | self._motors.io_requests()[rows]
        pots = samples.adc[rows] & (_POT_BITS << 16 | 0xFFFF)
        pots[:, self._potless] = pots[:, self._potless] & 0xFFFF | _NO_POT
        samples.adc[rows] = pots
        samples.positions[rows] &= reg.ENCODER_MASK
        words = samples.velocities[rows]
        ticks = (words & reg.VELOCITY_TICKS_MASK).astype(np.int64) * ESPM_CLOCKS // OUR_CLOCKS
        long = ticks > reg.VELOCITY_TICKS_MASK
        ticks[long] = reg.VELOCITY_TICKS_MASK | reg.VELOCITY_OVERFLOW
        samples.velocities[rows] = words & ~np.uint32(reg.VELOCITY_TICKS_MASK) | ticks.astype(np.uint32)
