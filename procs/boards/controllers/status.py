"""Status quadlets and the upper halves of motor status words: how each kind of controller shows its state."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from trocar.procs.boards.controllers.lines import Flags, Ints
from trocar.procs.boards.controllers.models import Traits
from trocar.procs.fpga import registers as reg

if TYPE_CHECKING:
    from trocar.procs.boards.controllers.power import BoardPower


_BOTH = 3  # the same for both QLAs of a DQLA


class StatusWords:
    """Composes them for boards with these traits."""

    def __init__(self, traits: Traits) -> None:
        """Assembles the constant parts."""
        self._traits = traits
        axes = traits.axes.sum(axis=1)
        self._fixed: Ints = axes << reg.STATUS_AXES_SHIFT | traits.ids << reg.STATUS_BOARD_SHIFT
        # Boards with an expander have the quad DAC: both came with QLA 1.5.
        self._fixed |= (traits.expander & traits.single) * reg.STATUS_QUAD_DAC
        self._fixed |= (traits.expander & traits.dual) * (_BOTH * reg.STATUS_DQLA_QUAD_DAC)
        self._fixed |= traits.dual * (_BOTH * reg.STATUS_DQLA_CONFIGURED)
        self._fixed |= (traits.digital & traits.ecm) * reg.STATUS_ECM
        self._bits = np.where(traits.by_control, 1 << np.arange(traits.axes.shape[1], dtype=np.int64), 0)
        self._analog = ~traits.digital[:, None] & traits.axes

    def status(self, power: BoardPower) -> Ints:
        """Status quadlets (boards,)."""
        traits, status = self._traits, self._fixed.copy()
        closed = power.relay_feedback & ~power.chain_open & ~traits.dual
        for flags, bit in ((power.watchdog, reg.STATUS_WATCHDOG), (power.good, reg.STATUS_MV_GOOD),
                           (power.wanted, reg.STATUS_POWER), (power.relay, reg.STATUS_RELAY),
                           (closed, reg.STATUS_RELAY_FEEDBACK)):
            status |= flags * bit
        interlocks = 0 if power.digital is None else power.digital.shown()
        status |= np.where(traits.single, self._of_qla(power), np.where(traits.dual, self._of_dqla(power), interlocks))
        return status

    def _of_qla(self, power: BoardPower) -> Ints:
        on, requests, safety = ((flags * self._bits).sum(axis=1) for flags in (power.on, power.enabled, power.safety))
        low = np.where(self._traits.shows_requests, requests, on)
        status: Ints = (on << reg.STATUS_AMP_ON_SHIFT | safety << reg.STATUS_SAFETY_SHIFT | low
                        | power.outputs_known * (reg.STATUS_DOUT_CONFIGURED | reg.STATUS_DOUT_BIDIRECTIONAL)
                        | power.supply_lost * reg.STATUS_MV_FAULT | power.expander_known * reg.STATUS_IO_EXPANDER
                        | (self._traits.expander & ~power.chain_open) * reg.STATUS_SAFETY_VOLTAGE)
        return status

    def _of_dqla(self, power: BoardPower) -> Ints:
        status: Ints = _BOTH * (power.good * reg.STATUS_DQLA_MV_GOOD | power.expander_known * reg.STATUS_DQLA_EXPANDER
                                | power.outputs_known * (reg.STATUS_DQLA_DOUT_CONFIGURED
                                                         | reg.STATUS_DQLA_DOUT_BIDIRECTIONAL)
                                | (self._traits.expander & ~power.chain_open) * reg.STATUS_DQLA_SAFETY_VOLTAGE)
        return status

    def motors(self, power: BoardPower, fault: Flags) -> npt.NDArray[np.uint32]:
        """Motor status words (boards, width) without the commanded values; `fault`: should be on and is not."""
        current = power.mode != reg.MODE_VOLTAGE
        current |= ~power.expander_known[:, None]
        words = power.on * reg.MOTOR_STATUS_AMP_ON | power.enabled * reg.MOTOR_STATUS_AMP_REQUESTED
        words |= power.mode << reg.MOTOR_STATUS_MODE_SHIFT
        analog = (current * reg.MOTOR_STATUS_CURRENT_CONTROL | power.safety * reg.MOTOR_STATUS_SAFETY
                  | fault * reg.MOTOR_STATUS_AMP_FAULT)
        codes = 0 if power.digital is None else power.digital.codes() << reg.MOTOR_STATUS_FAULT_SHIFT
        words |= np.where(self._analog, analog, codes)
        return words.astype(np.uint32)
