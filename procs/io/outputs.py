"""Words for the boards: currents as DAC words, amplifier enables, power and relay control.

Enables and power commands act once and are withdrawn after the write: repeated every cycle, they would clear the
boards' own fault latches as fast as those appear. Switching off and opening relays has no such side effect and is
repeated while no robot requests power, so that no lost packet leaves a motor on or a relay closed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from trocar.procs.fpga import conversion, registers
from trocar.procs.io.brakes import Brakes
from trocar.procs.io.record import Flags
from trocar.procs.io.robots import IoData

ENABLE = registers.DAC_VALID | registers.DAC_AMP_MASK | registers.DAC_AMP_ENABLE
DISABLE = registers.DAC_VALID | registers.DAC_AMP_MASK
PLAIN = registers.DAC_VALID


class Outputs:
    """Fills `port.out` from efforts (n,) and the brakes' currents (b,)."""

    def __init__(self, data: IoData, brakes: Brakes) -> None:
        robots, port, record = data.robots, data.port, data.record
        n = robots.drives
        self._robots, self._record, self.brakes = robots, record, brakes.current
        self._of_actuators = record.current_request[: robots.axes]
        self._of_brakes = record.current_request[robots.axes :]
        self._flat, self.columns = port.out.reshape(-1), port.out.shape[1]
        self._out_control = port.out[:, -1]
        self.index = robots.board_row * port.out.shape[1] + robots.channel
        self.encoder = conversion.CurrentEncoder(robots.dac_scale, robots.dac_offset)
        self.flags: NDArray[np.int64] = np.full(n, DISABLE, dtype=np.int64)
        self.words: NDArray[np.int64] = np.zeros(n, dtype=np.int64)
        """The value last written for each drive."""
        least, most = conversion.current_range(robots.dac_scale, robots.dac_offset)
        self.most = np.minimum(robots.maximum_current, most)
        self.least = np.maximum(-robots.maximum_current, least)
        self.control: NDArray[np.uint32] = np.full(len(robots.board_ids), registers.CONTROL_POWER_OFF, np.uint32)
        """Control words of the next write."""
        self._standing: NDArray[np.uint32] = self.control.copy()
        self.has_one_shot = False

    def command_power(self, boards: Flags, relay: bool) -> None:
        """Motor power on, and the relay closed, with the next write."""
        self._standing[boards] = 0
        self.control[boards] = registers.CONTROL_POWER_ON | (registers.CONTROL_RELAY_ON if relay else 0)
        self.has_one_shot = True

    def cut_power(self, boards: Flags, open_relays: bool) -> None:
        """Motor power off with every write from now on, and relays open if asked, or asked before."""
        self._standing[boards] |= np.uint32(
            registers.CONTROL_POWER_OFF | (registers.CONTROL_RELAY_OFF if open_relays else 0))
        self.control[boards] = self._standing[boards]

    def close_relays(self, boards: Flags) -> None:
        """Close the safety relays of boards with the next write."""
        self.control[boards] |= np.uint32(registers.CONTROL_RELAY_ON)
        self.has_one_shot = True

    def enable_amps(self, places: NDArray[np.intp]) -> None:
        """Enable the amplifiers of drives with the next write."""
        self.flags[places] = ENABLE
        self._record.amp_enabled[places] = True
        self.has_one_shot = True

    def disable_amps(self, places: NDArray[np.intp]) -> None:
        """Keep the amplifiers of drives disabled with every write from now on."""
        self.flags[places] = DISABLE
        self._record.amp_enabled[places] = False

    def all_off(self) -> None:
        """Amplifiers and motor power of all boards off, relays open; overrides all earlier requests."""
        self.flags.fill(DISABLE)
        self._record.amp_enabled[...] = False
        self._standing.fill(registers.CONTROL_POWER_OFF | registers.CONTROL_RELAY_OFF)
        self.control[...] = self._standing

    def encode(self, share: float) -> bool:
        """Encode a share of the record's efforts, and the control words, into the port's buffer; False: an effort was
        not finite, 0 A is written for it.
        """
        request = self._record.current_request
        np.multiply(self._record.setpoint_effort, self._robots.effort_to_current, self._of_actuators)
        if share != 1.0:
            np.multiply(self._of_actuators, share, self._of_actuators)
        self._of_brakes[...] = self.brakes
        np.minimum(request, self.most, out=request)
        np.maximum(request, self.least, out=request)
        finite = self.encoder.encode(request)
        np.bitwise_or(self.encoder.bits, self.flags, self.words)
        self._flat[self.index] = self.words
        self._out_control[...] = self.control
        return finite

    def written(self) -> None:
        """The boards have been written: withdraw the words that act once."""
        if self.has_one_shot:
            self.has_one_shot = False
            self.control[...] = self._standing
            self.flags[self.flags == ENABLE] = PLAIN
