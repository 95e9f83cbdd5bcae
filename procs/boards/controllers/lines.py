"""Wires between the boards of a bus and the robots: one array per kind of wire, a row per board."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from trocar.procs.fpga import registers as reg

Floats = npt.NDArray[np.float64]
Flags = npt.NDArray[np.bool_]
Ints = npt.NDArray[np.int64]
Quads = npt.NDArray[np.uint32]

NEVER = 1 << 62  # tick of an event that is not due
INPUTS_OPEN = 0x0FFF  # home and limit inputs are pulled up


@dataclass(frozen=True, slots=True)
class Lines:
    """Boards write `dac` and `on`, the world writes `adc` and `inputs`; (boards, width) and (boards,)."""

    dac: Quads  # commanded motor current, offset binary
    on: Flags  # amplifier output stage is on
    adc: Quads  # potentiometer << 16 | measured motor current
    inputs: Quads  # negative limits 11:8, positive limits 7:4, home 3:0

    @classmethod
    def of(cls, boards: int, width: int = reg.AXES) -> Lines:
        """Lines of this many boards with `width` axes, all unconnected."""
        shape = (boards, width)
        return cls(np.full(shape, reg.CURRENT_ZERO, dtype=np.uint32), np.zeros(shape, dtype=np.bool_),
                   np.full(shape, reg.CURRENT_ZERO, dtype=np.uint32),
                   np.full(boards, INPUTS_OPEN, dtype=np.uint32))

    def part(self, first: int, count: int) -> Lines:
        """The lines of `count` boards from `first` on, sharing memory with these."""
        cut = slice(first, first + count)
        return Lines(self.dac[cut], self.on[cut], self.adc[cut], self.inputs[cut])
