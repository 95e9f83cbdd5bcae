"""I/O expanders as the host reaches them through register 0x0E: the MAX7317 of a QLA, the two MAX7301 of a DQLA.

A write names a chip and sends it a command (register, data; the top bit of the register reads); a read of 0x0E returns
the result, or the chip's ports as a debug word. A read from a missing chip gets no answer.
"""

from __future__ import annotations

from typing import Final

_ID_SHIFT, _ID_MASK, _COMMAND, _DEBUG = 16, 0xF, 0xFFF0_0000, 1 << 30
_ANSWERING, _READ_PENDING = 0x4000_0000, 0x0800_0000
_READ, _READ_SHIFT = 0x8000, 8
_PORTS, _HIGH_PORTS, _MEMORY = 0x0E, 0x0F, 0x13  # registers of a MAX7317
_SETTINGS: Final = {0x09: 0xFF, 0x0A: 0xFF, 0x0B: 0x55, 0x0C: 0xFD, 0x0D: 0xFF, 0x0E: 0xFF, 0x0F: 0x55, 0x04: 0x01}


class Expanders:
    """Of one QLA (chip 0) or DQLA (chips 1 and 2 of its QLAs, 3 and 4 its own)."""

    def __init__(self, dual: bool, present: bool) -> None:
        """As after power-up; `present`: the QLAs have theirs."""
        self._dual, self._present = dual, present
        self._small: tuple[int, ...] = (1, 2) if dual else (0,)
        self._large: tuple[int, ...] = (3, 4) if dual else ()
        self._memory: dict[int, int] = {}  # of each chip
        self.power_up()

    def power_up(self) -> None:
        """The FPGA is reconfigured; the chips keep their memory."""
        self._addressed = -1  # none
        self._debug: dict[int, bool] = {}
        self._answer: dict[int, int] = {}
        self._pending: dict[int, bool] = {}

    @property
    def qla(self) -> int:
        """Which QLA the addressed chip sits on: 0 or 1."""
        return 1 if self._addressed == 2 else 0

    def address(self, value: int) -> None:
        """The register will be written: from now on the chip is addressed that the value names."""
        chip = value >> _ID_SHIFT & _ID_MASK
        self._addressed = chip if chip in (*self._small, *self._large) else -1

    def write(self, value: int, ports: tuple[int, int]) -> None:
        """Write the register; `ports` 7:0 and 9:8 of the QLA whose chip is addressed."""
        chip = self._addressed
        if chip < 0:
            return
        self._debug[chip] = bool(value & _DEBUG)
        if value & _COMMAND == 0:
            there = self._present or chip in self._large
            self._pending[chip] = bool(value & _READ) and not there
            if there:
                self._do(chip, value & 0xFFFF, ports)

    def _do(self, chip: int, command: int, ports: tuple[int, int]) -> None:
        register, data = command >> _READ_SHIFT & 0x7F, command & 0xFF
        if not command & _READ:
            if register == _MEMORY:
                self._memory[chip] = data
            return
        if chip in self._large:
            data = _SETTINGS.get(register, 0)
        else:
            low, high = ports
            known = {_PORTS: low, _HIGH_PORTS: high, _MEMORY: self._memory.get(chip, 0), 8: 1, 9: 1}
            data = known.get(register, low >> register & 1 if register < 8 else 0)
        self._answer[chip] = command & 0xFF00 | data

    def read(self, ports: tuple[int, int]) -> int:
        """Read the register; `ports` of the QLA whose chip is addressed."""
        chip = self._addressed
        if chip < 0:
            return 0
        if self._debug[chip] and chip in self._small:
            # A DQLA marks by bit 30 which chip answered; this word does not have that bit.
            return 0 if self._dual else ports[0] * 0x101
        return _ANSWERING | self._pending.get(chip, False) * _READ_PENDING | self._answer.get(chip, 0)
