"""Differences between the boards of a bus in power and motor commands, as arrays to compute with."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trocar.procs.boards.controllers.lines import Flags, Quads
from trocar.procs.boards.controllers.models import Model
from trocar.procs.fpga import registers as reg

_VALID, _AMP_MASK, _MODE = reg.DAC_VALID >> 24, reg.DAC_AMP_MASK >> 24, 0x0F  # in the top byte of a command word


@dataclass(frozen=True, slots=True)
class Traits:
    """Arrays (boards,), and (boards, width) where they are about axes; rows by ascending board id."""

    ids: npt.NDArray[np.int64]
    old: Flags  # firmware Rev 7
    late: Flags  # firmware Rev 9
    single: Flags  # QLA1
    dual: Flags  # DQLA
    digital: Flags  # dRA1: digital amplifiers
    prompt: Flags  # a dRA1 that cuts an amplifier as soon as its current was too far off for too long
    expander: Flags  # QLA from 1.5 on
    shows_requests: Flags  # in status bits 3:0, instead of the feedback once more
    ecm: Flags  # a dRA1 in an ECM
    axes: Flags  # there is a motor
    by_control: Flags  # motors with their enables in the control word
    real_time_bits: Quads  # of a control word, out of a real-time block
    considered: Quads  # in a command word's top byte: its value is taken if only the valid one of these bits is set
    amp_mask: Quads  # the bit of a command word's top byte that marks an enable

    @classmethod
    def of(cls, models: Sequence[Model], width: int) -> Traits:
        """Of these boards, in arrays for `width` axes."""
        names = np.array([model.hardware.name for model in models])
        firmware = np.array([model.firmware for model in models])
        old, single, digital = firmware == 7, names == "QLA1", names == "dRA1"
        expander = np.array([model.expander for model in models])
        axes = np.arange(width) < np.array([model.hardware.motors for model in models])[:, None]
        modes = np.where(expander, _MODE & ~1, np.where(old | digital, 0, _MODE))
        repeats = np.array([model.quirks.repeated_amp_bits for model in models])
        tardy = np.array([model.quirks.late_deviation for model in models])
        return cls(
            ids=np.array([model.board_id for model in models], dtype=np.int64), old=old, late=firmware >= 9,
            single=single, dual=names == "DQLA", digital=digital, prompt=digital & ~tardy,
            expander=expander, shows_requests=old | ~repeats,
            ecm=np.array([model.robot_serial.startswith("e") for model in models]), axes=axes,
            by_control=axes & single[:, None],
            real_time_bits=np.where(firmware >= 9, 0xFFFF_FFFF, reg.CONTROL_REAL_TIME_BITS).astype(np.uint32),
            considered=_spread(_VALID | modes, width), amp_mask=_spread(np.where(old, 0, _AMP_MASK), width))


def _spread(values: npt.NDArray[np.int64], width: int) -> Quads:
    """A value of each board, for each of its axes."""
    return np.repeat(values.astype(np.uint32)[:, None], width, axis=1)
