"""Register files of the chips at the ends of a board's wires: FireWire PHY, Ethernet chips of FPGA V2 and V3."""

from __future__ import annotations

from typing import Final

from trocar.procs.fpga import registers as reg

MDIO_TICKS: Final = 1024  # a frame of 64 bits, 16 ticks each
_GMII_CORE = 8  # address of the FPGA's own half of a port on the chip's management bus
_PAGE_SELECT, _DEFAULT_PAGE, _DELAY_PAGE = 31, 0xA42, 0xD08


class FirewirePhy:
    """A two-port 400 Mbit/s PHY behind the request and response registers 0x01 and 0x02."""

    def __init__(self, node: int) -> None:
        """As after a bus reset that gave it this node number."""
        self.requested = 0
        self.response = 0
        self.bus_resets = 0  # number of such requests by the host
        self._values = bytearray(16)
        # node; gap count; extended register set, two ports; 400 Mbit/s; link active
        self._values[:5] = bytes((node << 2, reg.GAP_DEFAULT, 0xE2, 0x40, 0x80))

    def bus_reset(self, node: int) -> None:
        """A bus reset gave it this node number."""
        self._values[0] = node << 2

    def request(self, value: int) -> None:
        """Write of 0x01: read a register (answered in `response`) or write one."""
        self.requested = value & 0xFFFF
        number = value >> reg.PHY_REGISTER_SHIFT & 0xF
        if not value & reg.PHY_WRITE:
            number = value & 0xF
            self.response = number << reg.PHY_REGISTER_SHIFT | self._read(number)
        elif number == 1:
            self._values[1] = value & 0xBF
            self.bus_resets += value >> 6 & 1
        elif number in (4, 7):
            self._values[number] = value & 0xFF
        elif number == 5:
            self._values[5] = value & 0x83  # the others clear themselves, or by writing 1
            self.bus_resets += value >> 6 & 1

    def _read(self, number: int) -> int:
        if number < 8:
            return self._values[number]
        # Page 1 names compliance (1394a) and vendor; it has no data about ports.
        identity = bytes((1, 0, 0x08, 0x00, 0x28, 0, 0, 0))
        return identity[number - 8] if self._values[7] >> 5 == 1 else 0


class Ksz8851:
    """Ethernet controller of FPGA V2, as the firmware has set it up; 16-bit registers at even addresses."""

    _FIXED = frozenset((0xC0, 0xF8))

    def __init__(self, board_id: int) -> None:
        """Initialised; the last of the address is the board's id."""
        self._values = {
            0x10: 0x9400 | board_id, 0x12: 0x0E13, 0x14: 0xFA61,  # address FA:61:0E:13:94:0n
            0x70: 0x01EF, 0x74: 0x7CE1, 0x76: 0x001C,  # transmit, receive: on, with checksums
            0x82: 0x0020, 0x84: 0x4000, 0x86: 0x4000, 0x9C: 0x0001,  # queues
            0x90: 0xA000,  # interrupts: receive, link change
            0xA2: 0x0008, 0xA4: 0x0020,  # hashes of the multicast addresses
            0xC0: 0x8872,  # chip
            0xF8: 0x0660,  # port: link good, negotiated, full duplex, 100 Mbit/s
        }

    def read(self, address: int, word: bool) -> int:
        """A register, or one byte of it."""
        value = self._values.get(address & 0xFE, 0)
        return value if word else value >> 8 * (address & 1) & 0xFF

    def write(self, address: int, value: int, word: bool) -> None:
        """Write a register or one byte of it; identity and port status are fixed."""
        even = address & 0xFE
        if even in self._FIXED:
            return
        if not word:
            shift = 8 * (address & 1)
            value = self._values.get(even, 0) & ~(0xFF << shift) | (value & 0xFF) << shift
        self._values[even] = value & 0xFFFF


class Rtl8211:
    """Ethernet PHY of one port of FPGA V3, and the FPGA's own half of the port, behind the management register."""

    def __init__(self, speed: int) -> None:
        """Initialised, link on; `speed` 0, 1, 2: 10, 100, 1000 Mbit/s."""
        self._speed = speed
        self._free = 0
        self._result = 0
        self._due: list[tuple[int, int]] = []  # (tick, result)
        self.reset()

    def reset(self) -> None:
        """As the firmware leaves it after a reset."""
        self._page = _DEFAULT_PAGE
        self._values = {
            (_DEFAULT_PAGE, 0): 0x1140, (_DEFAULT_PAGE, 1): 0x796D, (_DEFAULT_PAGE, 2): 0x001C,
            (_DEFAULT_PAGE, 3): 0xC916, (_DEFAULT_PAGE, 18): 0x0010,
            (_DEFAULT_PAGE, 26): 0x000C | self._speed << 4,  # link, full duplex
            (_DELAY_PAGE, 17): 0x0109, (_DELAY_PAGE, 21): 0x0019,  # delays of both directions on
        }
        self._core = {16: (self._speed & 1) << 13 | (self._speed >> 1) << 6}

    def request(self, word: int, tick: int) -> None:
        """Write of the management register: a frame; one may be on its way and one wait, more are lost."""
        self.result(tick)
        if len(self._due) > 1:
            return
        self._free = max(self._free, tick) + MDIO_TICKS
        chip, number = word >> 23 & 0x1F, word >> 18 & 0x1F
        if word >> 28 & 3 == 2:
            self._due.append((self._free, number << 16 | self._read(chip, number)))
        else:
            self._write(chip, number, word & 0xFFFF)
            self._due.append((self._free, (self._due[-1][1] if self._due else self._result)))

    def result(self, tick: int) -> int:
        """Read of the management register: number and value of the last register read."""
        while self._due and self._due[0][0] <= tick:
            self._result = self._due.pop(0)[1]
        return self._result

    def _place(self, number: int) -> tuple[int, int]:
        """Most registers are seen from every page."""
        return (_DELAY_PAGE if self._page == _DELAY_PAGE and number in (17, 21) else _DEFAULT_PAGE), number

    def _read(self, chip: int, number: int) -> int:
        if chip == _GMII_CORE:
            return self._core.get(number, 0)
        if chip > 1:
            return 0xFFFF  # no node there
        return self._page if number == _PAGE_SELECT else self._values.get(self._place(number), 0)

    def _write(self, chip: int, number: int, value: int) -> None:
        if chip == _GMII_CORE:
            self._core[number] = value
        elif chip <= 1 and number == _PAGE_SELECT:
            self._page = value
        elif chip <= 1 and number not in (1, 2, 3, 26):
            self._values[self._place(number)] = value
