"""Bits to SI units and back: (n,) arrays over actuators, results written in place.

Scales and offsets are those of the IO file. Two ways from a wrong number to a large current are excluded here: a value
that is not finite never becomes bits, and bits are reduced modulo 65536 like in the converter (an offset of −32768 is
equivalent to +32768), never saturated.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.fpga.registers import ENCODER_MASK, ENCODER_MIDRANGE

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

CURRENT_MASK: Final = 0xFFFF
FEEDBACK_FACTOR: Final = 1.2
FEEDBACK_MARGIN_A: Final = 0.05


def preload_bits(position: Floats, scale: Floats, offset: Floats) -> Ints:
    """Preload register values that make encoders read `position` [rad or m].

    Rounds, because truncation, as in the reference, loses a count in one of 260. ValueError if a position is not finite
    or outside the 24-bit counter.
    """
    counts = np.rint((position - offset) / scale)
    if not np.all(np.abs(counts) <= ENCODER_MIDRANGE - 1):
        raise ValueError("a position is not finite or outside the encoder's range")
    return counts.astype(np.int64) + ENCODER_MIDRANGE & ENCODER_MASK


class CurrentEncoder:
    """Motor currents [A] of n actuators to DAC bits; allocates nothing in `encode`."""

    def __init__(self, scale: Floats, offset: Floats) -> None:
        """`scale` and `offset` (n,) of current_to_bits."""
        self.scale, self.offset = scale, offset
        self._float = np.zeros(len(scale))
        self._finite = np.zeros(len(scale), dtype=bool)
        self._mask = np.full(len(scale), CURRENT_MASK, dtype=np.int64)
        self.zero = np.trunc(offset)
        self.bits: Ints = np.zeros(len(scale), dtype=np.int64)

    def encode(self, current: Floats) -> bool:
        """Fill `bits` (n,); False if a current was not finite: those axes got the bits of 0 A."""
        values = self._float
        np.multiply(current, self.scale, values)
        np.add(values, self.offset, values)
        np.isfinite(values, self._finite)
        finite = b"\0" not in self._finite.tobytes()
        if not finite:
            np.copyto(values, self.zero, where=~self._finite)
        np.copyto(self.bits, values, casting="unsafe")  # truncates toward zero, like the reference
        np.bitwise_and(self.bits, self._mask, self.bits)
        return finite


def current_range(scale: Floats, offset: Floats) -> tuple[Floats, Floats]:
    """Least and most current [A] of a 16-bit converter; beyond them, bits would wrap to the opposite sign."""
    turn = np.floor(np.trunc(offset) / (CURRENT_MASK + 1)) * (CURRENT_MASK + 1)
    ends = np.zeros((2, len(scale)))
    for row, bits in enumerate((turn + 0.5, turn + CURRENT_MASK - 0.5)):  # half a bit inside: they are truncated later
        np.divide(bits - offset, scale, out=ends[row], where=scale != 0.0)
    return ends.min(axis=0), ends.max(axis=0)


def inverse(scale: Floats) -> Floats:
    """1 / scale, 0 where the scale is 0 (an actuator without a motor has no effort)."""
    result: Floats = np.zeros_like(scale)
    np.divide(1.0, scale, out=result, where=scale != 0.0)
    return result


def are_nominal(offsets: Sequence[float]) -> bool:
    """Whether the current offsets of a robot's actuators were not measured: measured ones of three are never equal."""
    return len(offsets) > 2 and len(set(map(int, offsets))) == 1


def feedback_limit(maximum_current: Floats) -> Floats:
    """Largest measured current [A] tolerated while the amplifier is enabled."""
    return FEEDBACK_FACTOR * maximum_current + FEEDBACK_MARGIN_A
