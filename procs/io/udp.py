"""UDP to the controllers of a bus: to the hub, which bridges to FireWire, or to the address of every board."""

from __future__ import annotations

import contextlib
import ipaddress
import select
import socket
from collections.abc import Callable
from typing import Final

from procs.io.port import PortError
from procs.io.transport import closed
from procs.lib import registers, wire

RECEIVE_BUFFER_BYTES: Final = 1 << 20
FRAME_DATA_BYTES: Final = 1440  # of a block transfer in one Ethernet frame
ADDRESS_PAUSE_MS: Final = 200  # a board that got its address announces it before it answers again
OWN_ADDRESS: Final = 9  # from this firmware on a board adds its id to the address it is given
NODES: Final = 16

_Peer = tuple[str, int]


def is_loopback(address: str) -> bool:
    """True inside 127/8."""
    return ipaddress.IPv4Address(address).is_loopback


def discovery_address(address: str) -> str:
    """Where discovery asks: inside 127/8 the hub itself (systems run side by side), else its old-class broadcast."""
    if is_loopback(address):
        return address
    octets = address.split(".")
    first = int(octets[0])
    kept = 1 if first < 128 else 2 if first < 192 else 3 if first < 224 else 0
    return ".".join(octets[:kept] + ["255"] * (4 - kept))


def address_of(address: str, board: int) -> str:
    """The address of a board from Rev 9 on: the bus's, its last octet increased by the board id."""
    head, _, last = address.rpartition(".")
    return f"{head}.{(int(last) + board) % 256}"


class UdpTransport:
    """A `Transport` over one UDP socket.

    `bridge`: nobody is asked by multicast. `asked_at` replaces the address at which everybody is asked.
    """

    on_firewire = False
    send: Callable[[wire.Buffer], object]
    poll: Callable[[int], object]
    recv_into: Callable[[memoryview], int]

    def __init__(self, address: str, *, bridge: bool = False, udp_port: int = wire.UDP_PORT,
                 asked_at: str = "") -> None:
        self._address, self._udp_port, self._bridge = address, udp_port, bridge
        self._loopback = is_loopback(address)
        self._asked_at = asked_at or discovery_address(address)
        self.where = f"{address}:{udp_port}"
        self.gives_address: int | None = registers.ip_quadlet(address)
        self.pause_ms = 0 if self._loopback else ADDRESS_PAUSE_MS
        self.most_read = self.most_write = wire.MAX_DATA if self._loopback else FRAME_DATA_BYTES
        self._socket: socket.socket | None = None
        self._peers: list[_Peer] = []  # of everybody, or by node
        self.close()

    def open(self) -> None:
        """Make the socket. Inside 127/8 it has the bus's address: multicast is heard from there only."""
        self.close()
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        made.setblocking(False)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        poll = select.poll()
        poll.register(made, select.POLLIN)
        self._socket, self.poll, self.recv_into = made, poll.poll, made.recv_into
        with contextlib.suppress(OSError):  # whoever needs it is told when it is used
            if self._loopback:
                made.bind((self._address, 0))
            own = self._address if self._loopback else self._local_address()
            made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(own))

    def _local_address(self) -> str:
        """Of the interface that leads to the bus."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect((self._address, self._udp_port))  # sends nothing
            return str(probe.getsockname()[0])

    def close(self) -> None:
        """Close the socket; harmless when there is none."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None
        self.send = self.poll = self.recv_into = self._closed

    def _closed(self, _: object) -> int:
        raise closed(self.where)

    def ask_everybody(self) -> int:
        """By broadcast; inside 127/8 at the bus's address and, where that may be needed, by multicast, too."""
        if self._loopback and self._bridge and self._asked_at == self._address:
            self._connect(self._address)
            return 0
        self._peers = [(self._asked_at, self._udp_port)]
        if self._loopback and not self._bridge:
            self._peers.append((wire.MULTICAST, self._udp_port))
        self.send = self._send_to_everybody
        return 0

    def _send_to_everybody(self, datagram: wire.Buffer) -> None:
        sock, (first, *others) = self._open_socket(), self._peers
        sock.sendto(datagram, first)
        for peer in others:
            with contextlib.suppress(OSError):  # a machine without multicast has no Ethernet-only buses
                sock.sendto(datagram, peer)

    def aim(self, board: int, firmware: int, *, by_board: bool) -> int:
        """From now on requests go to the hub, and only its replies are heard, or to the boards themselves."""
        own = address_of(self._address, board) if firmware >= OWN_ADDRESS else self._address
        if by_board:
            self._peers = [(address_of(self._address, node), self._udp_port) for node in range(NODES)]
            self.send = self._send_by_board
        else:
            self._connect(own)
        return registers.ip_quadlet(own)

    def _send_by_board(self, datagram: wire.Buffer) -> None:
        node = datagram[3] & 0x3F
        self._open_socket().sendto(datagram, self._peers[node] if node < NODES else (wire.MULTICAST, self._udp_port))

    def _connect(self, address: str) -> None:
        """Only one peer's replies are heard from now on, and sending is cheaper."""
        sock = self._open_socket()
        try:
            sock.connect((address, self._udp_port))
        except OSError as error:
            where = f"{address}:{self._udp_port}"
            raise PortError(f"no route ({error.strerror})", where, "check the network") from error
        self.where = f"{address}:{self._udp_port}"
        self.send = sock.send

    def _open_socket(self) -> socket.socket:
        if self._socket is None:
            raise closed(self.where)
        return self._socket
