"""Status quadlets and the upper halves of motor status words: how each kind of controller shows its state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trocar.procs.boards.controllers.traits import Flags, Traits
from trocar.procs.fpga import registers as reg

Ints = npt.NDArray[np.int64]

_BOTH = 3  # the same for both QLAs of a DQLA


@dataclass(frozen=True, slots=True)
class StatusInputs:
    """What the words are made of; arrays (boards,), and (boards, width) for amplifiers."""

    watchdog: Flags
    good: Flags  # motor supply
    wanted: Flags  # motor power
    relay: Flags
    closed: Flags  # the relay's feedback
    lost: Flags  # motor supply fault
    outputs_known: Flags  # the kind of the digital outputs' hardware has been found out
    expander_known: Flags  # an I/O expander is there and has been found
    chain_open: Flags
    enabled: Flags  # as requested
    on: Flags
    safety: Flags  # cut because of the current
    fault: Flags  # should be on and is not
    mode: npt.NDArray[np.uint32]
    fault_code: npt.NDArray[np.uint32]  # dRA1
    interlocks: Ints  # dRA1, bits 3:0


class StatusWords:
    """Composes them for boards with these traits."""

    def __init__(self, traits: Traits) -> None:
        """What does not change is put together here."""
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

    def status(self, state: StatusInputs) -> Ints:
        """Status quadlets (boards,)."""
        status = self._fixed.copy()
        for flags, bit in ((state.watchdog, reg.STATUS_WATCHDOG), (state.good, reg.STATUS_MV_GOOD),
                           (state.wanted, reg.STATUS_POWER), (state.relay, reg.STATUS_RELAY),
                           (state.closed & ~self._traits.dual, reg.STATUS_RELAY_FEEDBACK)):
            status |= flags * bit
        status |= np.where(self._traits.single, self._of_qla(state),
                           np.where(self._traits.dual, self._of_dqla(state), state.interlocks))
        return status

    def _of_qla(self, state: StatusInputs) -> Ints:
        on, requests, safety = ((flags * self._bits).sum(axis=1)
                                for flags in (state.on, state.enabled, state.safety))
        low = np.where(self._traits.shows_requests, requests, on)
        status: Ints = (on << reg.STATUS_AMP_ON_SHIFT | safety << reg.STATUS_SAFETY_SHIFT | low
                        | state.outputs_known * (reg.STATUS_DOUT_CONFIGURED | reg.STATUS_DOUT_BIDIRECTIONAL)
                        | state.lost * reg.STATUS_MV_FAULT | state.expander_known * reg.STATUS_IO_EXPANDER
                        | (self._traits.expander & ~state.chain_open) * reg.STATUS_SAFETY_VOLTAGE)
        return status

    def _of_dqla(self, state: StatusInputs) -> Ints:
        status: Ints = _BOTH * (state.good * reg.STATUS_DQLA_MV_GOOD | state.expander_known * reg.STATUS_DQLA_EXPANDER
                                | state.outputs_known * (reg.STATUS_DQLA_DOUT_CONFIGURED
                                                         | reg.STATUS_DQLA_DOUT_BIDIRECTIONAL)
                                | (self._traits.expander & ~state.chain_open) * reg.STATUS_DQLA_SAFETY_VOLTAGE)
        return status

    def motors(self, state: StatusInputs) -> npt.NDArray[np.uint32]:
        """Motor status words (boards, width) without what was commanded."""
        current = state.mode != reg.MODE_VOLTAGE
        current |= ~state.expander_known[:, None]
        words = state.on * reg.MOTOR_STATUS_AMP_ON | state.enabled * reg.MOTOR_STATUS_AMP_REQUESTED
        words |= state.mode << reg.MOTOR_STATUS_MODE_SHIFT
        analog = (current * reg.MOTOR_STATUS_CURRENT_CONTROL | state.safety * reg.MOTOR_STATUS_SAFETY
                  | state.fault * reg.MOTOR_STATUS_AMP_FAULT)
        words |= np.where(self._analog, analog, state.fault_code << reg.MOTOR_STATUS_FAULT_SHIFT)
        return words.astype(np.uint32)
