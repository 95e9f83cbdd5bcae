"""Digital amplifiers, as the dRA1 has them: enables behind interlocks, latched faults, the ESPM of the arm.

An enable is a request that waits until all interlocks are closed: watchdog, motor supply, connection to the ESPM (the
electronics in the arm, which count the encoders), its connection further into the arm, and encoders preloaded since the
ESPM began. An open interlock or a fault cuts the amplifier, the request stays: another enable is needed to restore it.
Commands are not kept while an amplifier is off.

The deviation of the measured current from the commanded one is counted down in every cycle of the current loop in which
it is too large, and up in the others. Real ones have a bug here, emulated unless the quirk is off: the empty counter is
checked only when the amplifier has been switched off.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from trocar.procs.boards.controllers.lines import NEVER, Flags, Ints, Quads
from trocar.procs.boards.controllers.models import Traits
from trocar.procs.fpga import registers as reg

FAULT_CONVERTER, FAULT_DEVIATION, FAULT_BRIDGE = 1, 2, 4  # kept as bits, shown as codes 1, 2, 3
DEVIATION_TOP: Final = 0xFFF  # cycles: 57 ms
DEVIATION_LARGE, DEVIATION_SMALL = 0x200, 0x800  # of the first two motors, and of the smaller others: about 0.1 A
CYCLE_CLOCKS: Final = 2048  # of the current loop, of a clock three times as fast as ours
LARGE_MOTORS: Final = 2
PRELOAD_TICKS: Final = 12_288  # 0.25 ms: to the ESPM and back
COMM_CHECK_TICKS: Final = 1 << 19  # packets from the ESPM are looked for every 10.7 ms
ESPM_START: Final = reg.CLOCK_HZ // 2  # plausible
# Motors that share a bridge chip, and with it its fault line; counted from 0.
BRIDGES: Final = ((7, 8), (9, 0), (4, 1), (5, 2), (6, 3))


class Digital:
    """Arrays (boards,) and (boards, width) over all boards of a bus; `there` are the dRA1s."""

    def __init__(self, traits: Traits) -> None:
        """As after power-up."""
        self.there = there = traits.digital
        shape = traits.axes.shape
        self.axes = traits.axes & there[:, None]
        self.pending = np.zeros(shape, dtype=np.bool_)
        self.faults: Quads = np.zeros(shape, dtype=np.uint32)
        self.bypass = np.zeros(len(there), dtype=np.int64)  # of interlocks, in register order
        self.supplied, self.connected, self.preloaded = there.copy(), there.copy(), np.zeros_like(there)  # the ESPM
        self._connect_at, self._preload_at = (np.full(len(there), NEVER, dtype=np.int64) for _ in range(2))
        large = np.arange(shape[1]) < LARGE_MOTORS
        self._allowed = np.where(large, DEVIATION_LARGE, DEVIATION_SMALL)
        self._left = np.full(shape, DEVIATION_TOP, dtype=np.int64)
        self._deviates = np.zeros(shape, dtype=np.bool_)
        self._prompt, self._any_prompt = traits.prompt[:, None], bool(traits.prompt.any())
        self._cycle = 0
        self._regulated = np.zeros(shape, dtype=np.bool_)  # on, in current mode

    # -- as time goes by -----------------------------------------------------------------------------------------------

    def until(self, tick: int) -> None:
        """Changes that happen by themselves."""
        due = self._connect_at <= tick
        self.connected[due] = self.supplied[due]
        self.preloaded[due & self.supplied] = False  # until the first packet arrives
        self._connect_at[due] = NEVER
        due = self._preload_at <= tick
        self.preloaded |= due & self.connected
        self._preload_at[due] = NEVER

    def times(self) -> Ints:
        """When something will happen by itself."""
        times = np.minimum(self._connect_at, self._preload_at)
        if self._any_prompt:
            counting = self._prompt & self._regulated & self._deviates
            empty_at = -(-(self._cycle + self._left) * CYCLE_CLOCKS // 3)
            times = np.minimum(times, np.where(counting, empty_at, NEVER).min(axis=1))
        return times

    def pins(self, on: Flags, enabled: Flags, broken: Flags, closed: Flags, tick: int) -> Flags:
        """Whether each amplifier is on from `tick` on; `closed`: watchdog and supply, (2, boards)."""
        self._count(tick)
        self.faults |= np.where(broken & self.axes, FAULT_BRIDGE, 0).astype(np.uint32)
        if self._any_prompt:
            self._deviate(self._prompt & self._regulated)
        interlocks = np.array((*closed, self.connected, self.there, self.preloaded)) * (1 << np.arange(5))[:, None]
        whole = (interlocks.sum(axis=0) | self.bypass) == 0x1F
        pins: Flags = (on | self.pending) & enabled & (self.faults == 0) & whole[:, None] & self.axes
        self.pending &= ~pins
        self._deviate(self._regulated & ~pins)
        return pins

    def _deviate(self, looked_at: Flags) -> None:
        """Latch the fault of those whose counter is empty."""
        self.faults |= np.where(looked_at & (self._left == 0), FAULT_DEVIATION, 0).astype(np.uint32)

    def regulate(self, pins: Flags, mode: Quads) -> None:
        """These amplifiers regulate a current from now on."""
        self._regulated = pins & (mode == reg.MODE_CURRENT) & self.axes
        self._left[~self._regulated] = DEVIATION_TOP

    def _count(self, tick: int) -> None:
        cycle = tick * 3 // CYCLE_CLOCKS
        passed, self._cycle = cycle - self._cycle, cycle
        if passed:
            left = np.where(self._deviates, self._left - passed, self._left + passed)
            self._left = np.where(self._regulated, np.clip(left, 0, DEVIATION_TOP), DEVIATION_TOP)

    def compare(self, tick: int, asked: Ints, measured: Ints) -> bool:
        """Currents that hold from `tick` on (offset binary); whether that may switch an amplifier off."""
        self._count(tick)
        before, self._deviates = self._deviates, np.abs(asked - measured) > self._allowed
        turned = self._any_prompt and bool((self._prompt & (before != self._deviates)).any())
        stuck = self.axes & ((measured == 0) | (measured == 0xFFFF)) & (self.faults & FAULT_CONVERTER == 0)
        self.faults |= np.where(stuck, FAULT_CONVERTER, 0).astype(np.uint32)
        return turned or bool(stuck.any())

    # -- host accesses -------------------------------------------------------------------------------------------------

    def ask(self, axes: Flags) -> None:
        """Enables are commanded: faults are forgotten, and the enables wait for the interlocks."""
        self.pending |= axes & self.axes
        self.forgive(axes)

    def forgive(self, axes: Flags) -> None:
        """Faults are forgotten."""
        self.faults[axes & self.axes] = 0
        self._left[axes & self.axes] = DEVIATION_TOP

    @property
    def forgiven(self) -> bool:
        """Whether there is nothing to clear: repeated enables change nothing."""
        return not (np.count_nonzero(self.faults) or np.count_nonzero(self._deviates)
                    or np.count_nonzero(self._left != DEVIATION_TOP))

    def preload(self, row: int, tick: int) -> None:
        """The encoders of a board are preloaded, which its ESPM will remember."""
        self._preload_at[row] = tick + PRELOAD_TICKS

    def supply(self, row: int, on: bool, tick: int) -> None:
        """Switch the supply of an ESPM, which forgets that it was preloaded."""
        if on == self.supplied[row]:
            return
        self.supplied[row] = on
        self._connect_at[row] = tick + ESPM_START if on else (tick // COMM_CHECK_TICKS + 2) * COMM_CHECK_TICKS
        self._preload_at[row] = NEVER

    def power_up(self, row: int) -> None:
        """A board restarts, and with it its ESPM."""
        self.pending[row] = False
        self.faults[row] = 0
        self.bypass[row] = 0
        self.supplied[row] = self.connected[row] = self.there[row]
        self.preloaded[row] = False
        self._connect_at[row] = self._preload_at[row] = NEVER

    # -- status shown to the host --------------------------------------------------------------------------------------

    def shown(self) -> Ints:
        """Bits 3:0 of the status quadlet."""
        status: Ints = (self.preloaded * reg.STATUS_PRELOADED | self.supplied * reg.STATUS_ESPM_SUPPLY
                        | self.there * reg.STATUS_ESPM_REACHES_ARM | self.connected * reg.STATUS_ESPM)
        return status

    def codes(self) -> Quads:
        """The fault that counts, by axis: 0 none, 1 converter at its end, 2 deviation, 3 bridge."""
        codes = np.where(self.faults & FAULT_CONVERTER, 1, np.where(self.faults & FAULT_DEVIATION, 2, 3))
        return np.where(self.faults, codes, 0).astype(np.uint32)
