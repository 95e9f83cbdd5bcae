"""Raw Ethernet to the controllers of a bus: the datagrams of `wire` in frames of their own, without IP.

The frames carry their length in the type field. Boards are known by their MAC addresses, FA:61:0E:13:94 and the board
id; FB:61:0E:13:94:FF addresses all of them.
"""

from __future__ import annotations

import errno
import fcntl
import os
import select
import socket
import struct
import sys
from typing import Final

from trocar.procs.fpga import wire
from trocar.procs.io.bus.transport import RECEIVE_BUFFER_BYTES, PortError, Transport

ETHERNET_HARDWARE: Final = 1  # ARPHRD_ETHER
MAX_READ: Final = 976  # bytes: original hosts read frames of 1024 bytes at most, because of the firmware
MAX_WRITE: Final = 984
SIOCGIFHWADDR: Final = 0x8927  # kind of hardware and address of an interface

_LENGTH = struct.Struct(">H")
_REQUEST = struct.Struct("16s24x")


def interfaces() -> list[str]:
    """The Ethernet interfaces of this machine, in the order in which the system numbers them."""
    found = [(number, name) for number, name in socket.if_nameindex() if _is_ethernet(name)]
    return [name for _, name in sorted(found)]


def _is_ethernet(name: str) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asking:
        try:
            answer = fcntl.ioctl(asking, SIOCGIFHWADDR, _REQUEST.pack(name.encode()))
        except OSError:  # gone meanwhile
            return False
    return int.from_bytes(answer[16:18], sys.byteorder) == ETHERNET_HARDWARE


def interface_of(where: str) -> str:
    """The interface of a port name: its name, or its index among this machine's interfaces; PortError if there is none.
    """
    there = interfaces()
    if where in there:
        return where
    if where.isdecimal() and int(where) < len(there):
        return there[int(where)]
    listed = ", ".join(f"{place}: {name}" for place, name in enumerate(there)) or "none"
    raise PortError("no such Ethernet interface", f"port eth:{where}", f"of this machine: {listed}")


class EthernetTransport(Transport):
    """A `Transport` over one packet socket, which needs the right to make one (CAP_NET_RAW).

    It cannot `forget`: only the label distinguishes a late reply, and labels are reused.
    """

    most_read, most_write = MAX_READ, MAX_WRITE

    def __init__(self, where: str) -> None:
        """`where` is an interface, or its index among those of this machine; it is resolved in `open`."""
        self._named = where
        self.where = f"eth:{where}"
        self._socket: socket.socket | None = None
        self._head = bytearray(wire.FRAME_HEADER_BYTES)
        self._own = b""
        self._heads: list[bytes] = []  # by node: to and from
        self.close()

    def open(self) -> None:
        """Make the socket."""
        self.close()
        interface = interface_of(self._named)
        self.where = f"eth:{interface}"
        try:
            made = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, 0)  # receives nothing before it is bound
        except PermissionError as error:
            raise PortError("raw Ethernet is not permitted", self.where,
                            "give python3 the capability cap_net_raw, or use udp") from error
        try:
            made.bind((interface, wire.PLAIN_FRAMES))
            self._refuse_down(made)
            made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
            made.setblocking(False)
        except BaseException:
            made.close()
            raise
        poll = select.poll()
        poll.register(made, select.POLLIN)
        self._socket, self._own = made, bytes(made.getsockname()[4])
        self.poll, self.recv_into, self.send = poll.poll, self._receive, self._send
        self.ask_everybody()

    def _refuse_down(self, made: socket.socket) -> None:
        code = made.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if code == errno.ENETDOWN:
            raise PortError("the interface is down", self.where, "bring it up: ip link set NAME up")
        if code:
            raise PortError(os.strerror(code), self.where, "check the interface")

    def close(self) -> None:
        """Close the socket; harmless when there is none."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None
        self.shut()

    def ask_everybody(self) -> int:
        """No action: all boards receive all frames."""
        self._heads = [wire.GROUP_MAC + self._own] * (wire.BROADCAST + 1)
        return 0

    def aim(self, board: int, firmware: int, *, by_board: bool) -> int:
        """Address requests to the hub, or to the boards themselves."""
        for node in range(len(self._heads)):
            mac = wire.BOARD_MAC + bytes([node if by_board else board])
            self._heads[node] = (wire.GROUP_MAC if by_board and node >= wire.NODES else mac) + self._own
        return 0

    def _send(self, datagram: wire.Buffer) -> None:
        assert self._socket is not None
        head = self._heads[datagram[3] & 0x3F]
        self._socket.send(b"".join((head, _LENGTH.pack(len(datagram)), datagram)))

    def _receive(self, buffer: memoryview) -> int:
        """Short frames are padded, so the length in the frame counts."""
        assert self._socket is not None
        size, head = self._socket.recvmsg_into((self._head, buffer))[0], self._head
        length: int = _LENGTH.unpack_from(head, 12)[0]
        if head[:6] != self._own or head[6:11] != wire.BOARD_MAC or length > size - wire.FRAME_HEADER_BYTES:
            return 0
        return length
