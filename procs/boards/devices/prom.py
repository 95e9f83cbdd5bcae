"""The PROMs of one board behind their registers: the FPGA's (M25P16) and the QLA's (25AA128), and FPGA V3's stand-in.

The FPGA shifts commands to the chips bit by bit; while it does, the state in the low bits of the status register is not
0 and another command is ignored. Only a command that follows sooner than a frame on the real wire takes is delayed: a
host on the same machine is faster than any wire. Results and buffers already read as after the transfer, the result as
0 during it.
"""

from __future__ import annotations

from typing import Final

from trocar.procs.boards.devices import flash
from trocar.procs.boards.devices.flash import Chip

SERIAL_AT: Final = 0x1FFF00  # serial number of the FPGA in its PROM; the QLA's is at 0
SERIAL_COMMAND: Final = 0x031F_FF00  # the only one FPGA V3 heeds
PAGE_QUADS: Final = 64
BUFFER_QUADS: Final = 16
NO_SERIAL: Final = "0000-00"
FRAME_TICKS: Final = 330  # the shortest Ethernet frame at 100 Mbit/s

_SELECT, _WRITE, _WRITE_BLOCK, _READ, _DESELECT, _DISABLE = 1, 2, 3, 4, 5, 6  # states

# Bytes sent and received, by command: the part of a command word that the FPGA uses.
_FPGA_COMMANDS = {
    flash.WRITE_ENABLE: (1, 0), flash.WRITE_DISABLE: (1, 0), flash.IDENTIFY: (1, 3), flash.READ_STATUS: (1, 1),
    flash.WRITE_STATUS: (2, 0), flash.READ: (4, 4 * PAGE_QUADS), flash.ERASE_SECTOR: (4, 0), flash.ERASE_ALL: (1, 0),
    flash.SLEEP: (1, 0), flash.WAKE: (4, 1),
}
_FPGA_BYTE_TICKS = 16
_QLA_COMMANDS = {
    flash.WRITE_ENABLE: (1, 0), flash.WRITE_DISABLE: (1, 0), flash.READ_STATUS: (1, 1), flash.WRITE_STATUS: (2, 0),
    flash.READ: (3, 1), flash.PROGRAM: (4, 0),
}
_QLA_READ_BLOCK, _QLA_WRITE_BLOCK = 0xFE, 0xFF  # the FPGA's own commands; bits 3:0: quadlets minus 1
_QLA_BYTE_TICKS = 128


def serial_text(kind: str, number: str) -> bytes:
    """Serial number as stored in a PROM, "FPGA 1234-56"."""
    return f"{kind} {number or NO_SERIAL}".encode("ascii")


def _quads(data: bytes) -> list[int]:
    return [int.from_bytes(data[k : k + 4], "big") for k in range(0, len(data), 4)]


def _bytes(quads: list[int]) -> bytes:
    return b"".join((quad & 0xFFFF_FFFF).to_bytes(4, "big") for quad in quads)


class Prom:
    """A chip that the FPGA shifts commands to, one transfer at a time, each a row of states; and the FPGA's buffer."""

    def __init__(self, kind: flash.Kind, serial_at: int, serial: bytes, quads: int) -> None:
        """At rest; `serial` in the chip, else erased, and `quads` of the buffer are read."""
        self.chip = Chip(kind)
        self.chip.load(serial_at, serial)
        self._free = 0  # tick from which on it is at rest
        self._states: list[tuple[int, int]] = []  # (tick it ends, state)
        self._result, self._quads = 0, quads
        self._buffer = [0] * quads

    def _begin(self, tick: int, *phases: tuple[int, int]) -> int | None:
        """Begin a transfer: (state, ticks) of its middle part. Returns its end tick; None: busy."""
        if self._free - tick > FRAME_TICKS:
            return None
        self._states = [(end, state) for end, state in self._states if end > tick]
        at = max(tick, self._free)
        for state, ticks in ((_SELECT, 1), *phases, (_DESELECT, 1), (_DISABLE, 1)):
            at += ticks
            self._states.append((at, state))
        self._free = at
        return at

    def status(self, tick: int) -> int:
        """The state after `tick`: bits 2:0 are 0 when the last command is over."""
        return next((state for end, state in self._states if tick < end), 0)

    def result(self, tick: int) -> int:
        """Result of the last command, or the number of quadlets it read or wrote; 0 until it has ended."""
        return 0 if tick < self._free else self._result

    def read(self, index: int, count: int, tick: int) -> list[int]:
        """Quadlets of the buffer."""
        return [self._buffer[(index + k) % self._quads] for k in range(count)]


class FpgaProm(Prom):
    """M25P16 behind 0x08, 0x09 and the page buffer at 0x2000 (FPGA V1 and V2)."""

    def __init__(self, serial: str) -> None:
        """With the board's serial number in it, else erased."""
        super().__init__(flash.M25P16, SERIAL_AT, serial_text("FPGA", serial), PAGE_QUADS)
        self._buffer += [0, 0]  # the command word of a write is there too

    def command(self, value: int, tick: int) -> None:
        """Write of 0x08: a command word."""
        sizes = _FPGA_COMMANDS.get(value >> 24)
        if sizes is None:
            return
        sent, count = sizes
        end = self._begin(tick, (_WRITE, sent * _FPGA_BYTE_TICKS), (_READ, count * _FPGA_BYTE_TICKS))
        if end is None:
            return
        answer = self.chip.transfer(_bytes([value])[:sent], count, end)
        if count > 4:
            self._buffer[:PAGE_QUADS] = _quads(answer)
            self._result = PAGE_QUADS
        else:
            self._result = int.from_bytes(answer, "big")

    def write(self, index: int, quads: list[int], tick: int) -> None:
        """Block write to the page buffer: goes straight to the chip, the first quadlet is the command word."""
        quads = quads[: len(self._buffer)]
        if index % PAGE_QUADS or not quads:
            return
        end = self._begin(tick, (_WRITE_BLOCK, 4 * len(quads) * _FPGA_BYTE_TICKS))
        if end is not None:
            self._buffer[: len(quads)] = quads
            self._result = len(quads)
            self.chip.transfer(_bytes(quads), 0, end)


class SerialOnly:
    """FPGA V3's replacement for `FpgaProm`: only the serial number."""

    def __init__(self, serial: str) -> None:
        """With the board's serial number."""
        self._serial = _quads(serial_text("FPGA", serial)[:16].ljust(16, b"\xff"))
        self._shown = False

    def command(self, value: int, tick: int) -> None:
        """Write of 0x08: the serial number's address shows it, any other command hides it."""
        self._shown = value == SERIAL_COMMAND

    def status(self, tick: int) -> int:
        """Always at rest."""
        return 0

    def result(self, tick: int) -> int:
        """Always a whole page."""
        return PAGE_QUADS

    def read(self, index: int, count: int, tick: int) -> list[int]:
        """The serial number in the first four quadlets, where it is shown."""
        places = [(index + k) % PAGE_QUADS for k in range(count)]
        return [self._serial[at] if self._shown and at < len(self._serial) else 0xFFFF_FFFF for at in places]

    def write(self, index: int, quads: list[int], tick: int) -> None:
        """The first four quadlets hold the serial number."""
        for at, quad in enumerate(quads, index % PAGE_QUADS):
            if at < len(self._serial):
                self._serial[at] = quad


class QlaProm(Prom):
    """25AA128 behind 0x3000 to 0x3002 and the buffer at 0x3100."""

    def __init__(self, serial: str) -> None:
        """With the board's serial number in it, else erased."""
        super().__init__(flash.E25AA128, 0, serial_text("QLA", serial) + b"\0", BUFFER_QUADS)

    def command(self, value: int, tick: int) -> None:
        """Write of 0x3000: a command word."""
        code, length = value >> 24, 4 * ((value & 0xF) + 1)
        word = _bytes([value])
        if code == _QLA_READ_BLOCK:
            self._transfer(bytes([flash.READ]) + word[1:3], length, tick)
        elif code == _QLA_WRITE_BLOCK:
            self._transfer(bytes([flash.PROGRAM]) + word[1:3] + _bytes(self._buffer)[:length], 0, tick)
        elif code in _QLA_COMMANDS:
            sent, count = _QLA_COMMANDS[code]
            self._transfer(word[:sent], count, tick)

    def _transfer(self, sent: bytes, count: int, tick: int) -> None:
        end = self._begin(tick, (_WRITE, len(sent) * _QLA_BYTE_TICKS), (_READ, count * _QLA_BYTE_TICKS))
        if end is None:
            return
        answer = _quads(self.chip.transfer(sent, count, end))
        self._buffer[: len(answer)] = answer  # a single byte too
        self._result = answer[-1] if answer else 0

    def write(self, index: int, quads: list[int], tick: int) -> None:
        """Fill the buffer; the chip gets it with a command."""
        for k, quad in enumerate(quads, index):
            self._buffer[k % BUFFER_QUADS] = quad
