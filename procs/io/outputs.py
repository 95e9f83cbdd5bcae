"""What goes to the boards: currents as DAC words, amplifier enables, power and relay control.

Enables and power commands act once and are taken back after the write: repeated every cycle they would clear the
boards' own fault latches as fast as those appear. Switching off has no such side effect and is repeated as long as
nobody wants power, so that no lost packet leaves a motor on.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from procs.fpga import conversion, registers
from procs.io.brakes import Brakes
from procs.io.bus.port import Port
from procs.io.record import Flags, Floats, IoRecord
from procs.io.robots import Robots

ENABLE = registers.DAC_VALID | registers.DAC_AMP_MASK | registers.DAC_AMP_ENABLE
DISABLE = registers.DAC_VALID | registers.DAC_AMP_MASK
PLAIN = registers.DAC_VALID


class Outputs:
    """Fills `port.out` from efforts (n,) and the brakes' currents (b,)."""

    def __init__(self, robots: Robots, port: Port, record: IoRecord, brakes: Brakes) -> None:
        n = robots.drives
        self._robots, self._record, self._brakes = robots, record, brakes.current
        self._of_actuators = record.current_request[: robots.axes]
        self._of_brakes = record.current_request[robots.axes :]
        self._out = port.out.reshape(-1)
        self._control = port.out[:, -1]
        self._index = robots.board_row * port.out.shape[1] + robots.channel
        self._encoder = conversion.CurrentEncoder(robots.dac_scale, robots.dac_offset)
        self._flags: NDArray[np.int64] = np.full(n, DISABLE, dtype=np.int64)
        self._words: NDArray[np.int64] = np.zeros(n, dtype=np.int64)
        least, most = conversion.current_range(robots.dac_scale, robots.dac_offset)
        self._most = np.minimum(robots.maximum_current, most)
        self._least = np.maximum(-robots.maximum_current, least)
        self._standing: NDArray[np.uint32] = np.full(len(robots.board_ids), registers.CONTROL_POWER_OFF, np.uint32)
        self._once: NDArray[np.uint32] = self._standing.copy()
        self._pages = False

    def command_power(self, boards: Flags, relay: bool) -> None:
        """Motor power on, and the relay closed, with the next write."""
        self._standing[boards] = 0
        self._once[boards] = registers.CONTROL_POWER_ON | (registers.CONTROL_RELAY_ON if relay else 0)
        self._pages = True

    def cut_power(self, boards: Flags, open_relays: bool) -> None:
        """Motor power off with every write from now on; the relay opens once if asked."""
        self._standing[boards] = registers.CONTROL_POWER_OFF
        self._once[boards] = registers.CONTROL_POWER_OFF | (registers.CONTROL_RELAY_OFF if open_relays else 0)
        self._pages = True

    def close_relays(self) -> None:
        """Close the safety relays of all boards with the next write."""
        self._once |= np.uint32(registers.CONTROL_RELAY_ON)
        self._pages = True

    def enable_amps(self, places: NDArray[np.intp]) -> None:
        """Enable the amplifiers of drives with the next write."""
        self._flags[places] = ENABLE
        self._record.amp_enabled[places] = True
        self._pages = True

    def disable_amps(self, places: NDArray[np.intp]) -> None:
        """Keep the amplifiers of drives disabled with every write from now on."""
        self._flags[places] = DISABLE
        self._record.amp_enabled[places] = False

    def all_off(self) -> None:
        """Amplifiers and motor power of all boards off, relays open, whatever was asked for before."""
        self._flags.fill(DISABLE)
        self._record.amp_enabled[...] = False
        self._standing.fill(registers.CONTROL_POWER_OFF)
        self._once.fill(registers.CONTROL_POWER_OFF | registers.CONTROL_RELAY_OFF)
        self._pages = True

    def encode(self, effort: Floats, share: float = 1.0) -> bool:
        """A share of efforts [N·m or N] to words in the port's buffer; False: one was not finite, it is 0 A there."""
        request = self._record.current_request
        np.multiply(effort, self._robots.effort_to_current, self._of_actuators)
        if share != 1.0:
            np.multiply(self._of_actuators, share, self._of_actuators)
        self._of_brakes[...] = self._brakes
        np.minimum(request, self._most, out=request)
        np.maximum(request, self._least, out=request)
        finite = self._encoder.encode(request)
        np.bitwise_or(self._encoder.bits, self._flags, self._words)
        self._out[self._index] = self._words
        self._control[...] = self._once if self._pages else self._standing
        return finite

    def written(self) -> None:
        """The boards have it: what acts once is taken back."""
        if self._pages:
            self._pages = False
            self._once[...] = self._standing
            self._flags[self._flags == ENABLE] = PLAIN
