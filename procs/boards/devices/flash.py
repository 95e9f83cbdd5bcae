"""Serial memory chips as their data sheets have them: write-enable latch, page program, erase, protection, busy times.

A chip is accessed in transfers: bytes go in, bytes come out, and the requested operation starts when the chip is
deselected. While it programs or erases, it ignores everything except a read of its status.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from trocar.procs.fpga import registers as reg

WRITE_STATUS: Final = 0x01
PROGRAM: Final = 0x02
READ: Final = 0x03
WRITE_DISABLE: Final = 0x04
READ_STATUS: Final = 0x05
WRITE_ENABLE: Final = 0x06
IDENTIFY: Final = 0x9F
WAKE: Final = 0xAB
SLEEP: Final = 0xB9
ERASE_ALL: Final = 0xC7
ERASE_SECTOR: Final = 0xD8

BUSY: Final = 0x01  # of the chip's status
ENABLED: Final = 0x02
_PROTECT_SHIFT = 2
MICROSECOND: Final = reg.CLOCK_HZ / 1_000_000


@dataclass(frozen=True, slots=True)
class Kind:
    """Features of one type of chip; times in ticks, 0: no such command."""

    size: int
    page: int
    address_bytes: int
    program: int
    write_status: int
    status_mask: int  # bits of the status that can be written
    protect_mask: int  # of them, after the shift: how much of the upper end is protected
    protect_part: int  # bytes that the smallest protection covers; each next one covers twice as much
    overwrites: bool = False  # EEPROM; a flash only turns ones into zeros until it is erased
    sector: int = 0
    erase_sector: int = 0
    erase_all: int = 0
    identity: bytes = b""
    signature: bytes = b""


# Typical times of the data sheets; at most they are 5 ms, 15 ms, 3 s and 40 s (M25P16), 5 ms (25AA128).
M25P16: Final = Kind(
    size=1 << 21, page=256, address_bytes=3, program=round(640 * MICROSECOND), write_status=round(1300 * MICROSECOND),
    status_mask=0x9C, protect_mask=7, protect_part=1 << 16, sector=1 << 16, erase_sector=round(600_000 * MICROSECOND),
    erase_all=round(13_000_000 * MICROSECOND), identity=bytes.fromhex("202015"), signature=b"\x14")
E25AA128: Final = Kind(
    size=1 << 14, page=64, address_bytes=2, program=round(3000 * MICROSECOND), write_status=round(3000 * MICROSECOND),
    status_mask=0x8C, protect_mask=3, protect_part=1 << 12, overwrites=True)


class Chip:
    """One chip and its memory; bytes never written, or erased, read 0xFF."""

    def __init__(self, kind: Kind) -> None:
        """Erased, write-protected by its latch."""
        self.kind = kind
        self._pages: dict[int, bytearray] = {}  # by number; erased ones are not there
        self._bits = 0  # writable bits of the status
        self._enabled = False
        self._asleep = False
        self._busy_until = 0

    def load(self, address: int, data: bytes) -> None:
        """Store data at once, as before delivery."""
        for k, value in enumerate(data, address):
            self._page(k // self.kind.page)[k % self.kind.page] = value

    def transfer(self, sent: bytes, count: int, tick: int) -> bytes:
        """`sent` is shifted in, then `count` bytes out; the chip is deselected at `tick`. Nothing drives: 0xFF."""
        if self._busy_until and tick >= self._busy_until:
            self._busy_until, self._enabled = 0, False
        if sent[0] == READ_STATUS and not self._asleep:
            return bytes([self._bits | (BUSY if self._busy_until else 0) | (ENABLED if self._enabled else 0)]) * count
        answer = b"" if self._busy_until else self._answer(sent, count, tick)
        return answer[:count].ljust(count, b"\xff")

    def _answer(self, sent: bytes, count: int, tick: int) -> bytes:
        """Output of a chip that is not busy; starts the requested operation."""
        kind, command = self.kind, sent[0]
        if command == WAKE and kind.signature:
            self._asleep = False
            return kind.signature
        if self._asleep:
            return b""
        if command == READ:
            at = self._address(sent)
            return bytes(self._byte((at + k) % kind.size) for k in range(count))
        if command == IDENTIFY:
            return kind.identity
        self._begin(command, sent, tick)
        return b""

    def _begin(self, command: int, sent: bytes, tick: int) -> None:
        """A command that changes something; one that is not of its exact length is not carried out."""
        kind = self.kind
        exact = {WRITE_STATUS: 2, ERASE_SECTOR: 1 + kind.address_bytes, PROGRAM: len(sent)}.get(command, 1)
        if len(sent) != exact:
            return
        if command in (WRITE_ENABLE, WRITE_DISABLE):
            self._enabled = command == WRITE_ENABLE
            return
        if command == SLEEP and kind.signature:
            self._asleep = True
            return
        if not self._enabled:
            return
        data = sent[1 + kind.address_bytes :]
        addressed = len(sent) > kind.address_bytes and not self._protected(self._address(sent))
        if command == WRITE_STATUS:
            self._bits = sent[1] & kind.status_mask
            self._busy_until = tick + kind.write_status
        elif command == PROGRAM and data and addressed:
            self._program(self._address(sent), data)
            self._busy_until = tick + kind.program
        elif command == ERASE_SECTOR and kind.erase_sector and addressed:
            self._erase(self._address(sent) // kind.sector * kind.sector, kind.sector)
            self._busy_until = tick + kind.erase_sector
        elif command == ERASE_ALL and kind.erase_all and not self._protected(kind.size - 1):
            self._pages.clear()
            self._busy_until = tick + kind.erase_all

    def _address(self, sent: bytes) -> int:
        return int.from_bytes(sent[1 : 1 + self.kind.address_bytes], "big") % self.kind.size

    def _protected(self, address: int) -> bool:
        level = self._bits >> _PROTECT_SHIFT & self.kind.protect_mask
        return bool(level) and address >= self.kind.size - (self.kind.protect_part << level - 1)

    def _page(self, number: int) -> bytearray:
        return self._pages.setdefault(number, bytearray(b"\xff" * self.kind.page))

    def _byte(self, address: int) -> int:
        page = self._pages.get(address // self.kind.page)
        return 0xFF if page is None else page[address % self.kind.page]

    def _program(self, address: int, data: bytes) -> None:
        """Within the page, past its end on at its beginning; of too many bytes the last ones count."""
        page, latch = self._page(address // self.kind.page), {}
        for k, value in enumerate(data, address):
            latch[k % self.kind.page] = value
        for at, value in latch.items():
            page[at] = value if self.kind.overwrites else page[at] & value

    def _erase(self, address: int, size: int) -> None:
        for number in range(address // self.kind.page, (address + size) // self.kind.page):
            self._pages.pop(number, None)
