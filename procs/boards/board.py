"""The quiet registers of one board: what is asked for at start-up and by hand, never in the cycle."""

from __future__ import annotations

from collections.abc import Callable

from procs.lib import registers as reg

ETHERNET_V2 = 0xA01C_0000  # FPGA V2: initialised, UDP seen, link, idle
IP_UNASSIGNED = 0xFFFF_FFFF
PROM_ID = 0x0020_2015  # M25P16
FPGA_SERIAL_AT = 0x1FFF00
PAGE_BYTES = 256
QLA_PROM_BYTES = 16384
PHY_GAP = 1


def _serial(kind: str, number: str) -> bytes:
    return f"{kind} {number or '0000-00'}".encode("ascii")


class Board:
    """Identity, PHY, PROMs and digital outputs of one board."""

    def __init__(self, node: int, firmware: int, serial: str) -> None:
        """As after power-up; `serial` is the board's number (dddd-dd), shown by FPGA and QLA PROM alike."""
        self.firmware = firmware
        self.outputs = 0  # register polarity: 1 is a low pin
        self.show_watchdog = 0
        self._phy = bytearray(16)
        self._phy[0:4] = bytes((node << 2, reg.GAP_DEFAULT, 0xE2, 0x40))
        self._phy_response = 0
        self._ip = IP_UNASSIGNED
        self._fpga_serial = _serial("FPGA", serial)
        self._page = bytearray(PAGE_BYTES)
        self._prom_result = 0
        self._qla_prom = bytearray(_serial("QLA", serial) + b"\0").ljust(QLA_PROM_BYTES, b"\xff")
        self._qla_buffer = bytearray(64)
        self._qla_result = 0
        self._read: dict[int, Callable[[], int]] = {
            reg.PHY_RESPONSE: lambda: self._phy_response,
            reg.HARDWARE_ID: lambda: reg.QLA1,
            reg.DIGITAL_OUTPUT: lambda: self.outputs,
            reg.FIRMWARE: lambda: self.firmware,
            reg.PROM_RESULT: lambda: self._prom_result,
            reg.IP_ADDRESS: lambda: self._ip,
            reg.ETHERNET: lambda: ETHERNET_V2,
            reg.QLA_PROM_RESULT: lambda: self._qla_result,
        }
        self._write: dict[int, Callable[[int], None]] = {
            reg.PHY_REQUEST: self._phy_request,
            reg.DIGITAL_OUTPUT: self._set_outputs,
            reg.PROM_COMMAND: self._fpga_prom,
            reg.IP_ADDRESS: self._set_ip,
            reg.QLA_PROM_COMMAND: self._qla_prom_command,
        }

    def read(self, address: int) -> int:
        """Value of a register; 0 for what is not there."""
        get = self._read.get(address)
        return get() if get else 0

    def write(self, address: int, value: int) -> None:
        """Write a register; nothing happens for what is not there or read-only."""
        put = self._write.get(address)
        if put:
            put(value)

    def read_block(self, address: int, size: int) -> bytes:
        """`size` bytes of a buffer, zeros beyond it."""
        for start, memory in ((reg.FPGA_PROM, self._page), (reg.QLA_PROM_BUFFER, self._qla_buffer)):
            if start <= address < start + len(memory) // 4:
                return bytes(memory[(address - start) * 4 :][:size]).ljust(size, b"\0")
        return b"".join(self.read(address + k).to_bytes(4, "big") for k in range(size // 4))

    def write_block(self, address: int, data: bytes) -> None:
        """Fill a buffer; what lies outside is ignored."""
        start = (address - reg.QLA_PROM_BUFFER) * 4
        if 0 <= start < len(self._qla_buffer):
            self._qla_buffer[start : start + len(data)] = data[: len(self._qla_buffer) - start]

    def _phy_request(self, value: int) -> None:
        if value & reg.PHY_WRITE:
            self._phy[value >> reg.PHY_REGISTER_SHIFT & 0xF] = value & 0xFF
        else:
            self._phy_response = (value & 0xF) << reg.PHY_REGISTER_SHIFT | self._phy[value & 0xF]

    def _set_outputs(self, value: int) -> None:
        mask = value >> 8 & 0xF
        self.outputs = self.outputs & ~mask | value & mask

    def _set_ip(self, value: int) -> None:
        self._ip = value

    def _fpga_prom(self, value: int) -> None:
        command, address = value >> 24, value & 0xFFFFFF
        if value == 0x9F or command == 0x9F:
            self._prom_result = PROM_ID
        elif command == 0x03:
            page = bytearray(b"\xff" * PAGE_BYTES)
            at = FPGA_SERIAL_AT - address
            if 0 <= at < PAGE_BYTES:
                text = self._fpga_serial[: PAGE_BYTES - at]
                page[at : at + len(text)] = text
            self._page = page
            self._prom_result = PAGE_BYTES // 4
        else:
            self._prom_result = 0

    def _qla_prom_command(self, value: int) -> None:
        command, address = value >> 24, value >> 8 & 0xFFFF
        if command == 0x03:
            self._qla_result = self._qla_prom[address % QLA_PROM_BYTES]
        elif command == 0x02:
            self._qla_prom[address % QLA_PROM_BYTES] = value & 0xFF
        elif command in (0xFE, 0xFF):
            count = ((value & 0xF) + 1) * 4
            place = slice(address % QLA_PROM_BYTES, address % QLA_PROM_BYTES + count)
            if command == 0xFE:
                self._qla_buffer[:count] = self._qla_prom[place].ljust(count, b"\xff")
            else:
                self._qla_prom[place] = self._qla_buffer[: len(self._qla_prom[place])]
