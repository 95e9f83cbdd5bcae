"""Network registers of a board: IP address, Ethernet status and control, PHY requests, switch and debug blocks.

The firmware is a released one: built without debug data: its debug blocks report that or, on V3, read as zeros.

The only automatic event here is the end of a PHY reset: until then the status shows no link (`linked`).
"""

from __future__ import annotations

from typing import Final

from trocar.procs.boards.devices.phy import FirewirePhy, Ksz8851, Rtl8211
from trocar.procs.fpga import registers as reg

ETHERNET_DATA: Final = 0x4000
FIREWIRE_DATA: Final = 0x5000
IP_UNASSIGNED: Final = 0xFFFF_FFFF
MULTICAST_IP: Final = 0xE000_0064  # 224.0.0.100
SWITCH_NAME: Final = 0x3057_5345  # "ESW0" as the host has it in memory
NO_DEBUG_DATA: Final = 0x3047_4244  # "DBG0" as the host has it in memory

# Ethernet status register
FRAME_ERROR: Final = 1 << 28
IPV4_ERROR: Final = 1 << 27
PORT_ERROR: Final = 1 << 26
DESTINATION_ERROR: Final = 1 << 25
ACCESS_ERROR: Final = 1 << 24
LINK_ERROR: Final = 1 << 23  # V2
STATE_ERROR: Final = 1 << 22
REQUEST_ERROR: Final = 1 << 30  # V2
_NETWORK_ERRORS = FRAME_ERROR | IPV4_ERROR | PORT_ERROR | DESTINATION_ERROR | ACCESS_ERROR | STATE_ERROR
_LINK_ERRORS = LINK_ERROR | REQUEST_ERROR
_V2 = 0x8010_0000  # present, UDP
_V2_UP = 0x200C_0000  # initialised, link, idle
_V3 = 0x40B0_0000  # both clocks run, UDP
_V3_PS = 1 << 16  # the processor's own Ethernet, Rev 9
_PORT_UP = {8: 0xB0, 9: 0xA0}  # initialised, link, speed in 4:3: as it was seen with Rev 8 and Rev 9
_PORT_SPEED_SHIFT = 3

# Ethernet control register
CLEAR_NETWORK: Final = 1 << 29
CLEAR_LINK: Final = 1 << 28  # V2
RESET_PHY: Final = 1 << 26
_WRITE_REGISTER, _WORD, _DMA = 1 << 25, 1 << 24, 1 << 27  # V2
_PORT_BITS = (1 << 7, 1 << 15)  # V3: which PHY is reset
_PS_MASK = 1 << 25  # V3: bit 16 counts

_MILLISECOND = reg.CLOCK_HZ // 1000
V2_RESET_TICKS: Final = 53 * _MILLISECOND
V3_RESET_TICKS: Final = 170 * _MILLISECOND
LINK_TICKS: Final = 2000 * _MILLISECOND  # negotiation after a reset: plausible


class Network:
    """The network side of one board."""

    def __init__(self, fpga: int, firmware: int, board_id: int, node: int) -> None:
        """As after power-up with the link up. ValueError for other FPGAs."""
        if fpga not in (2, 3):
            raise ValueError(f"FPGA V{fpga}; allowed: 2 and 3")
        self.errors = 0  # bits of the status register, set where datagrams arrive
        self.ip = IP_UNASSIGNED
        self.phy = FirewirePhy(node)
        self._v3, self._rev_9 = fpga == 3, firmware >= 9
        self._id, self._node = board_id, node
        self._up = _PORT_UP[9 if self._rev_9 else 8]
        self._chip = Ksz8851(board_id)
        self._ports = tuple(Rtl8211(self._up >> _PORT_SPEED_SHIFT & 3) for _ in range(2))
        self._resets = [1, 1]
        self._reset_at = [-LINK_TICKS, -LINK_TICKS]  # tick of the last reset of each port
        self._processor = self._rev_9
        self._data = 0  # V2: last chip register read or written

    def read(self, address: int, tick: int) -> int:
        """Value of one of the registers here; 0 for a missing register."""
        if address >= ETHERNET_DATA:
            return self._block(address & 0xFFF, tick) if address < FIREWIRE_DATA else 0
        return {reg.PHY_REQUEST: self.phy.requested, reg.PHY_RESPONSE: self.phy.response, reg.IP_ADDRESS: self.ip,
                reg.ETHERNET: self._status(tick)}.get(address, 0)

    def write(self, address: int, value: int, tick: int, relayed: bool = True) -> None:
        """Write a register; `relayed`: it arrived over FireWire, on V2 the only way to the Ethernet chip."""
        if address == reg.PHY_REQUEST:
            self.phy.request(value)
        elif address == reg.IP_ADDRESS:
            own = self._id if self._rev_9 and value != IP_UNASSIGNED else 0
            self.ip = value + (own << 24) & 0xFFFF_FFFF
        elif address == reg.ETHERNET:
            self._control(value, tick, relayed)
        elif address in (ETHERNET_DATA | 0x1A0, ETHERNET_DATA | 0x2A0):
            self._ports[(address >> 8 & 3) - 1].request(value, tick)

    def linked(self, tick: int, port: int = 0) -> bool:
        """Whether a port (0 or 1; V2 has one) has its link: not for a while after its PHY was reset."""
        return tick - self._reset_at[port] >= LINK_TICKS

    # -- Ethernet status and control -----------------------------------------------------------------------------------

    def _ready(self, tick: int, port: int) -> bool:
        return tick - self._reset_at[port] >= (V3_RESET_TICKS if self._v3 else V2_RESET_TICKS)

    def _status(self, tick: int) -> int:
        if not self._v3:
            up = _V2_UP if self._ready(tick, 0) else 0
            return _V2 | (up if self.linked(tick) else up & ~(1 << 19)) | self.errors | self._data
        status = _V3 | self.errors & _NETWORK_ERRORS | (_V3_PS if self._processor else 0)
        for port in range(2):
            if self._ready(tick, port):
                status |= (self._up if self.linked(tick, port) else 0x80) << 8 * port
        return status

    def _control(self, value: int, tick: int, relayed: bool) -> None:
        if value & CLEAR_NETWORK:
            self.errors &= ~_NETWORK_ERRORS
        if self._v3:
            for port, bit in enumerate(_PORT_BITS):
                if value & RESET_PHY and value & bit and self._ready(tick, port):
                    self._reset(port, tick)
                    self._ports[port].reset()
            if self._rev_9 and value & _PS_MASK:
                self._processor = bool(value & _V3_PS)
            return
        if not relayed:
            return
        if value & CLEAR_LINK:
            self.errors &= ~_LINK_ERRORS
        if not self._ready(tick, 0):
            self.errors |= REQUEST_ERROR
        elif value & RESET_PHY:
            self._reset(0, tick)
            self._chip = Ksz8851(self._id)
        elif not value >> 28 and not value & _DMA:
            register, word = value >> 16 & 0xFF, bool(value & _WORD)
            if value & _WRITE_REGISTER:
                self._chip.write(register, value & 0xFFFF, word)
                self._data = value & 0xFFFF
            else:
                self._data = self._chip.read(register, word)

    def _reset(self, port: int, tick: int) -> None:
        self._reset_at[port] = tick
        self._resets[port] = self._resets[port] + 1 & 0xFF

    # -- blocks at 0x4000 ----------------------------------------------------------------------------------------------

    def _block(self, offset: int, tick: int) -> int:
        port, place = offset >> 8, offset & 0xFF
        if place >> 4 == 8:
            return NO_DEBUG_DATA
        if place >> 4 == 9 and not port:  # of the Ethernet chip; on V3 with Rev 9 there is none
            return 0 if self._v3 and (self._rev_9 or place & 0xF >= 8) else NO_DEBUG_DATA
        if place >> 5 == 5 and not port and self._rev_9:
            return self._switch(tick)[place & 0x1F]
        if self._v3 and port in (1, 2) and place == 0xA0:
            return self._ports[port - 1].result(tick)
        if self._v3 and self._rev_9 and port in (1, 2) and place == 0xA1:
            return self._resets[port - 1] << 16
        return 0

    def _switch(self, tick: int) -> list[int]:
        """Statistics of the Ethernet switch: ports Eth1, Eth2, processor, real-time. No datagrams are counted."""
        quads = [0] * 32
        quads[0] = SWITCH_NAME
        if not self._v3:
            quads[1] = 0x9000_0008 | self.linked(tick)
            return quads
        fast = (self._up >> _PORT_SPEED_SHIFT & 3) == 2
        active = self.linked(tick) | self.linked(tick, 1) << 1 | self._processor << 2 | 8
        quads[1] = 0xF000_0000 | (0xC | 3 * fast) << 4 | active
        quads[6] = MULTICAST_IP
        quads[7] = 0xF0 | active
        quads[17] = 0xFFFF  # all buffers empty
        return quads
