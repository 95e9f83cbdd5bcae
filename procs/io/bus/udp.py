"""UDP to the controllers of a bus: to the hub, which bridges to FireWire, or to the address of every board."""

from __future__ import annotations

import contextlib
import errno
import ipaddress
import secrets
import select
import socket
from typing import Final

from trocar.procs.fpga import registers, wire
from trocar.procs.io.bus.transport import RECEIVE_BUFFER_BYTES, PortError, Transport

FRAME_DATA_BYTES: Final = 1440  # of a block transfer in one Ethernet frame
ADDRESS_PAUSE_MS: Final = 200  # a board announces a new address before it answers again
FIRST_PORT: Final = 49152  # of the ports for any use
PORTS: Final = 16384
BIND_TRIES: Final = 64

_Peer = tuple[str, int]


def is_loopback(address: str) -> bool:
    """Whether an address is inside 127/8."""
    return ipaddress.IPv4Address(address).is_loopback


def discovery_address(address: str) -> str:
    """Address for discovery: inside 127/8 the hub itself (systems run side by side), else its old-class broadcast."""
    if is_loopback(address):
        return address
    octets = address.split(".")
    first = int(octets[0])
    kept = 1 if first < 128 else 2 if first < 192 else 3 if first < 224 else 0
    return ".".join(octets[:kept] + ["255"] * (4 - kept))


def address_of(address: str, board: int) -> str:
    """The address of a board from Rev 9 on: that of the bus with its last octet increased by the board id."""
    head, _, last = address.rpartition(".")
    return f"{head}.{(int(last) + board) % 256}"


class UdpTransport(Transport):
    """A `Transport` over one UDP socket at a time, each with a port that was long unused.

    Boards reply to the port that sent the request. So all later replies to earlier requests find the port of an earlier
    socket closed. Replies count only when they come from the port of the controllers at an address of this bus: that of
    the hub, once known (the kernel checks that), or of the board named in the reply.

    `bridge`: no multicast. `asked_at` replaces the address for requests to all boards.
    """

    def __init__(self, address: str, *, bridge: bool = False, udp_port: int = wire.UDP_PORT,
                 asked_at: str = "") -> None:
        self._address, self._udp_port, self._bridge = address, udp_port, bridge
        self._loopback = is_loopback(address)
        self._asked_at = asked_at or discovery_address(address)
        self.where = f"{address}:{udp_port}"
        self.gives_address = registers.ip_quadlet(address)
        self.pause_ms = 0 if self._loopback else ADDRESS_PAUSE_MS
        self.most_read = self.most_write = wire.MAX_DATA if self._loopback else FRAME_DATA_BYTES
        self._socket: socket.socket | None = None
        self._own = ""  # address of the interface that leads to the bus; empty: none
        # Ports are taken in an order that visits all of them and cannot be guessed.
        self._port, self._stride = secrets.randbelow(PORTS), 2 * secrets.randbelow(PORTS // 2) + 1
        self._boards: list[_Peer] = [(address_of(address, node), udp_port) for node in range(wire.NODES)]
        self._senders = frozenset(self._boards)
        self._by_node: list[_Peer | None] = self._boards + [None] * (wire.BROADCAST + 1 - wire.NODES)
        self._hub: _Peer | None = None  # the only destination
        self._everybody: list[_Peer] = []
        self.close()

    def open(self) -> None:
        """Make the socket."""
        self.close()
        with contextlib.suppress(OSError):  # a missing network is reported at the first use
            self._own = self._address if self._loopback else self._local_address()
        self.ask_everybody()

    def _local_address(self) -> str:
        """Address of the interface that leads to the bus."""
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            probe.connect((self._address, self._udp_port))  # sends nothing
            return str(probe.getsockname()[0])

    def close(self) -> None:
        """Close the socket; harmless when there is none."""
        if self._socket is not None:
            self._socket.close()
        self._socket, self.fd = None, -1
        self.shut()

    # -- destinations ------------------------------------------------------------------------------------------------

    def ask_everybody(self) -> int:
        """Address requests to all boards: by broadcast; inside 127/8 at the bus's address and, where that may be
        needed, by multicast, too.
        """
        self._everybody = [(self._asked_at, self._udp_port)]
        if self._loopback and not self._bridge:
            self._everybody.append((wire.MULTICAST, self._udp_port))
        alone = self._loopback and self._bridge and self._asked_at == self._address
        self._speak_to(self._everybody[0] if alone else None)
        return 0

    def aim(self, board: int, firmware: int, *, by_board: bool) -> int:
        """Address requests to the hub, and receive only its replies, or to the boards themselves."""
        own = address_of(self._address, board) if firmware >= registers.OWN_ADDRESS else self._address
        self._everybody = []
        self._speak_to(None if by_board else (own, self._udp_port))
        return registers.ip_quadlet(own)

    def _speak_to(self, hub: _Peer | None) -> None:
        self._hub = hub
        where = hub or (self._address, self._udp_port)
        self.where = f"{where[0]}:{where[1]}"
        try:
            self._renew()
        except OSError as error:
            raise PortError(f"no route ({error.strerror})", self.where, "check the network") from error

    def forget(self) -> bool:
        """Take a new socket; False: none is available, because of a missing network or resources."""
        self._open_socket()
        with contextlib.suppress(OSError):
            self._renew()
            return True
        return False

    def _renew(self) -> None:
        """Replace the socket."""
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._prepare(made)
        except BaseException:
            made.close()
            raise
        self.close()
        poll = select.poll()
        poll.register(made, select.POLLIN)
        self._socket, self.poll = made, poll.poll
        if self._hub is not None:
            self.send, self.recv_into, self.fd = made.send, made.recv_into, made.fileno()
        else:
            self.send = self._send_to_everybody if self._everybody else self._send_by_board
            self.recv_into = self._receive

    def _prepare(self, made: socket.socket) -> None:
        made.setblocking(False)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        if self._hub is None:
            made.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
            if self._own:
                made.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton(self._own))
        self._bind(made)
        if self._hub is not None:
            made.connect(self._hub)  # receives only its replies, and sends faster

    def _bind(self, made: socket.socket) -> None:
        """Bind to the next free port; inside 127/8 at the bus's address, the only one that receives multicast."""
        for _ in range(BIND_TRIES):
            self._port = (self._port + self._stride) % PORTS
            try:
                made.bind((self._address if self._loopback else "", FIRST_PORT + self._port))
                return
            except OSError as error:
                if error.errno != errno.EADDRINUSE:
                    raise
        raise OSError(errno.EADDRINUSE, "no free UDP port")

    # -- datagrams -----------------------------------------------------------------------------------------------------

    def _send_to_everybody(self, datagram: wire.Buffer) -> None:
        sock, (first, *others) = self._open_socket(), self._everybody
        sock.sendto(datagram, first)
        for peer in others:
            with contextlib.suppress(OSError):  # a machine without multicast has no Ethernet-only buses
                sock.sendto(datagram, peer)

    def _send_by_board(self, datagram: wire.Buffer) -> None:
        node = datagram[3] & 0x3F
        peer = self._boards[node] if node < wire.NODES else (wire.MULTICAST, self._udp_port)
        self._open_socket().sendto(datagram, peer)

    def _receive(self, buffer: memoryview) -> int:
        """A known board must send its own replies; before, and for replies that name no board, any address of the bus
        may.
        """
        size, sender = self._open_socket().recvfrom_into(buffer)
        if self._everybody or size <= wire.TRAILER_BYTES:
            is_theirs = sender in self._senders
        else:
            is_theirs = sender == self._by_node[buffer[5] & 0x3F]
        if is_theirs:
            return size
        self.stranger = f"{sender[0]}:{sender[1]}"
        return 0

    def _open_socket(self) -> socket.socket:
        if self._socket is None:
            raise self.is_closed()
        return self._socket
