"""Registers 0x9000 to 0xBFFF of a dRA1: current loops, data from the electronics in the arm (ESPM), the board itself.

Accessed at start-up and by hand, never in the cycle.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from trocar.procs.boards.controllers.digital import BRIDGES
from trocar.procs.boards.controllers.lines import Lines
from trocar.procs.boards.controllers.motors import Motors
from trocar.procs.boards.controllers.power import BoardPower
from trocar.procs.boards.controllers.samples import BoardSamples
from trocar.procs.boards.devices.board import Board

CONTROL, ARM, BOARD = 0x9, 0xA, 0xB  # regions
NOTHING, NOTHING_CONTROL = 0xCCCC, 0xCCCC_CCCC  # of registers that are not there
SUPPLY_BITS: Final = 36570  # 48 V as the board measures it
BYPASS, ARM_SUPPLY = 0xB100, 0xB102
FLASH_COMMAND, FLASH_WORD = 0x02, 0x31  # within the arm's 64 words
_FLASH_READ = 1 << 28 | 1 << 24
_FLASH_BYTES = 32
_GAINS: Final = {1: 2000, 2: 200, 3: 1000, 4: 1000, 5: 0, 6: 0, 0xC: 0}  # offset of a motor: at power-up
_GAIN_MASKS: Final = {1: 0x3FFFF, 2: 0x3FFFF, 3: 0xFFFF, 4: 0xFFFF, 5: 0x3FFFF, 6: 0x3FFFF, 0xC: 0xFFFF}
_MODE, _DUTY, _FAULT = 0, 0xA, 0xB
_BRIDGES_WELL, _BUILD = 0x3FF, 0x100
_PACKET_TICKS = 4288  # 67 quadlets, two ticks a bit
_MODEL_AT, _VERSION_AT = 0xA4, 0xA8  # in an instrument's memory
_NO_MODEL, _NO_VERSION = 0xFFFF_FFFF, 0xFF
# The arm's words: blocks of eight, the first of which is special.
_SWITCHES, _ARM_STATUS, _PRELOADED, _INSTRUMENT, _INSTRUMENT_VERSION = 0, 8, 16, 24, 32
_POTS, _POSITIONS, _VELOCITIES = 0, 1, 2
_REACHED, _ECM = 2, 1  # arm status


class Espm:
    """Those of the board in `row`."""

    def __init__(self, row: int, board: Board, lines: Lines, power: BoardPower, motors: Motors,
                 samples: BoardSamples) -> None:
        """As after power-up."""
        self._row, self._board, self._lines = row, board, lines
        self._power, self._motors, self._samples = power, motors, samples
        self.power_up()

    def power_up(self) -> None:
        """All written values are cleared."""
        motors = self._board.model.hardware.motors
        self._gains = {motor: dict(_GAINS) for motor in range(1, motors + 1)}
        self._flash_at = 0

    def write(self, address: int, value: int, tick: int) -> None:
        """Write a register of these regions; no effect on missing registers."""
        region, motor, offset = address >> 12, address >> 4 & 0xF, address & 0xF
        if region == CONTROL and motor in self._gains and offset in _GAIN_MASKS:
            self._gains[motor][offset] = value & _GAIN_MASKS[offset]
        elif region == ARM and address & 0x3F == FLASH_COMMAND:
            if value & _FLASH_READ == _FLASH_READ:
                self._flash_at = value & 0xFF_FFFF
        elif address == BYPASS:
            self._power.bypass_interlocks(self._row, value, tick)
        elif address == ARM_SUPPLY:
            self._power.supply_espm(self._row, bool(value & 1), tick)

    def read(self, address: int, tick: int) -> int:
        """Read one; the sample must have been brought up to `tick`."""
        region = address >> 12
        if region == CONTROL:
            return self._control(address >> 4 & 0xF, address & 0xF)
        return self._word(address & 0x3F) if region == ARM else self._of_board(address & 0xFFF, tick)

    def _control(self, motor: int, offset: int) -> int:
        if motor not in self._gains:
            return 0
        axis = (self._row, motor - 1)
        if offset == _MODE:
            return int(self._power.mode[axis])
        if offset == _DUTY:
            duty = int(self._motors.io_requests()[axis]) >> 5
            return (duty - (duty >> 10 << 11)) & 0xFFFF_FFFF
        if offset == _FAULT:
            return int(self._power.digital.faults[axis]) if self._power.digital is not None else 0
        return self._gains[motor].get(offset, NOTHING_CONTROL)

    def _of_board(self, offset: int, tick: int) -> int:
        row, power = self._row, self._power
        broken = np.flatnonzero(power.amp_fault[row])
        values = {0x001: tick // _PACKET_TICKS, 0x002: int(power.good[row]) * SUPPLY_BITS,
                  0x004: _BRIDGES_WELL & ~sum(1 << bit for bit in {_bridge_bit(int(axis)) for axis in broken}),
                  0x000: 0, 0x010: self._word(_ARM_STATUS), 0x012: self._word(_INSTRUMENT),
                  0x013: self._word(_INSTRUMENT_VERSION), 0x020: int(self._samples.temperatures[row]),
                  0x021: int(self._lines.inputs[row]), 0xFFF: _BUILD}
        return values.get(offset, NOTHING)

    def _word(self, at: int) -> int:
        """One of the 64 words sent by the arm."""
        row, samples = self._row, self._samples
        if at == _SWITCHES:
            return int(self._lines.inputs[row])
        if at == _ARM_STATUS:
            return _REACHED | int(self._power.traits.ecm[row]) * _ECM
        if at == _PRELOADED:
            return int(self._power.digital.preloaded[row]) if self._power.digital is not None else 0
        if at in (_INSTRUMENT, _INSTRUMENT_VERSION):
            return self._instrument(at)
        if at == FLASH_WORD:
            text = self._board.model.robot_serial.encode().ljust(_FLASH_BYTES, b"\0")
            return int.from_bytes(text[2 * self._flash_at : 2 * self._flash_at + 2], "little")
        block, axis = at >> 3, (at & 7) - 1
        if axis < 0 or block > _VELOCITIES + 3:
            return 0
        if block == _POTS:
            return (int(samples.adc[row, axis]) >> 16) << 6
        if block == _POSITIONS:
            return int(samples.positions[row, axis])
        return int(samples.velocities[row, block - _VELOCITIES, axis])

    def _instrument(self, at: int) -> int:
        memory = self._board.dallas.memory
        if memory is None:
            return _NO_MODEL if at == _INSTRUMENT else _NO_VERSION
        if at == _INSTRUMENT_VERSION:
            return memory[_VERSION_AT]
        return int.from_bytes(b"\0" + bytes(memory[_MODEL_AT + 1 : _MODEL_AT + 4]), "little")


def _bridge_bit(axis: int) -> int:
    """Bit of the fault line of an axis' bridge, the first chip's on top."""
    return len(BRIDGES) - 1 - next(chip for chip, axes in enumerate(BRIDGES) if axis in axes)
