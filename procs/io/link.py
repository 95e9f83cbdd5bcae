"""One UDP socket to the hub of a bus: transaction labels, bus generation, deadlines, retries of set-up reads."""

from __future__ import annotations

import contextlib
import ipaddress
import select
import socket
from collections.abc import Callable
from typing import Final

import numpy as np

from procs.io.port import Counters, PortError, Quads
from procs.lib import wire

RECEIVE_BUFFER_BYTES: Final = 1 << 20
DATAGRAM_BYTES: Final = 4096  # more than any board sends
CYCLE_TIMEOUT_MS: Final = 2
SETUP_TIMEOUT_MS: Final = 20
SIMULATED_TIMEOUT_MS: Final = 2000  # simulated time stands still while we wait: only a lost peer may end the wait
SETUP_TRIES: Final = 5
MAX_STRAYS: Final = 64  # thrown away within one read before it counts as failed

TIMED_OUT: Final = 0
DROPPED: Final = -1


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


class Link:
    """The socket and what belongs to a transaction. The newest datagram lies in `rx` after a successful receive."""

    def __init__(self, address: str, udp_port: int, now_ns: Callable[[], int], real_time: bool,
                 spin_ns: int = 0) -> None:
        """`spin_ns`: how long to look for a reply again and again before sleeping until there is one."""
        self.address = address
        self.udp_port = udp_port
        self.now_ns = now_ns
        self.real_time = real_time
        self.spin_ns = spin_ns if real_time else 0  # a clock that stands still would never end it
        self.counters = Counters(0)  # the port's own takes its place
        self.cycle_timeout_ms = CYCLE_TIMEOUT_MS if real_time else SIMULATED_TIMEOUT_MS
        self.generation = 0  # the bus generation our requests carry
        self.seen_generation = 0  # the one the newest reply carried
        self.tl = 0
        self.recv_ns = 0
        self.send_ns = 0
        self.rx = memoryview(bytearray(DATAGRAM_BYTES))
        self.rx_quads: Quads = np.frombuffer(self.rx, np.uint32)  # the same bytes: not swapped yet
        self.suspect = True  # stale datagrams may be queued
        self._socket: socket.socket | None = None
        self._peer: tuple[str, int] | None = None

    @property
    def where(self) -> str:
        """The other end, for messages."""
        return f"{self.address}:{self.udp_port}"

    def open(self) -> None:
        """Make the socket."""
        self.close()
        made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        made.setblocking(False)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BUFFER_BYTES)
        poll = select.poll()
        poll.register(made, select.POLLIN)
        self._socket, self._poll = made, poll.poll
        self._recv_into = made.recv_into
        self.generation = self.seen_generation = 0
        self.suspect = True

    def close(self) -> None:
        """Close the socket; harmless when there is none."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None

    def aim(self, address: str, *, connect: bool) -> None:
        """Send to `address` from now on; connected, only its replies are heard and sending is cheaper."""
        sock = self._open_socket()
        self._peer = None if connect else (address, self.udp_port)
        try:
            if connect:
                sock.connect((address, self.udp_port))
        except OSError as error:
            where = f"{address}:{self.udp_port}"
            raise PortError(f"no route ({error.strerror})", where, "check the network") from error
        self.address = address

    def next_tl(self) -> int:
        """The label of the next transaction: 1, 2 … 63, 0, 1 …"""
        self.tl = tl = (self.tl + 1) % wire.TL_COUNT
        return tl

    def send(self, datagram: wire.Buffer) -> bool:
        """Send one datagram; False when the system refused it (nobody listens, no buffer, no route)."""
        try:
            self._send(datagram)
        except ConnectionRefusedError:
            # Nobody listened to an earlier datagram; hearing of it cleared the error, and this one was not sent.
            self.suspect = True
            try:
                self._send(datagram)
            except OSError:
                return False
        except OSError:
            return False
        self.send_ns = self.now_ns()
        return True

    def _send(self, datagram: wire.Buffer) -> None:
        sock = self._open_socket()
        if self._peer is None:
            sock.send(datagram)
        else:
            sock.sendto(datagram, self._peer)

    def receive(self, tl: int, timeout_ms: int) -> int:
        """Wait for the reply with label `tl`: its size in `rx`, or TIMED_OUT or DROPPED. Others are thrown away."""
        rx, left_ms = self.rx, timeout_ms
        begin_ns = self.now_ns()
        deadline_ns = begin_ns + timeout_ms * 1_000_000
        if self.spin_ns:
            spin_until_ns = begin_ns + self.spin_ns
            while not self._poll(0) and self.now_ns() < spin_until_ns:
                pass
        for _ in range(MAX_STRAYS):
            if not self._poll(left_ms):
                break
            try:
                size = self._recv_into(rx)
            except OSError:  # an ICMP "nobody listens" of an earlier send: as good as silence
                size = 0
            self.recv_ns = now_ns = self.now_ns()
            if size >= wire.TRAILER_BYTES:
                if size == wire.TRAILER_BYTES:
                    self.seen_generation = rx[1]
                    self.counters.dropped += 1
                    self.suspect = True
                    return DROPPED
                if rx[2] >> 2 == tl:
                    self.seen_generation = rx[size - 7]
                    return size
            self.counters.stray += 1
            # A simulated clock stands still meanwhile; there MAX_STRAYS is the bound.
            left_ms = max(0, (deadline_ns - now_ns + 999_999) // 1_000_000)
        self.counters.timeouts += 1
        self.suspect = True
        return TIMED_OUT

    def drain(self) -> None:
        """Throw away what is queued, when anything may be: late or doubled replies to earlier reads."""
        for _ in range(MAX_STRAYS):
            if not self._poll(0):
                self.suspect = False
                return
            with contextlib.suppress(OSError):
                self._recv_into(self.rx)
                self.counters.stray += 1

    def read_quadlet(self, node: int, address: int, *, flags: int = 0, timeout_ms: int | None = None,
                     tries: int = SETUP_TRIES) -> int | None:
        """One register of a node; None when it does not answer. Reads have no side effects: lost ones are repeated."""
        if timeout_ms is None:
            timeout_ms = SETUP_TIMEOUT_MS if self.real_time else SIMULATED_TIMEOUT_MS
        for _ in range(tries):
            self._open_socket()
            self.drain()
            tl = self.next_tl()
            if not self.send(wire.quadlet_read(node, address, tl, self.generation, flags)):
                continue
            size = self.receive(tl, timeout_ms)
            reply = self._decode(size, wire.QUADLET_RESPONSE, node)
            if reply is not None:
                return reply.value
        return None

    def read_block(self, node: int, address: int, length: int, *, flags: int = 0, timeout_ms: int | None = None,
                   tries: int = SETUP_TRIES) -> bytes | None:
        """`length` bytes of a node; None when it does not answer."""
        if timeout_ms is None:
            timeout_ms = SETUP_TIMEOUT_MS if self.real_time else SIMULATED_TIMEOUT_MS
        for _ in range(tries):
            self._open_socket()
            self.drain()
            tl = self.next_tl()
            if not self.send(wire.block_read(node, address, length, tl, self.generation, flags)):
                continue
            size = self.receive(tl, timeout_ms)
            reply = self._decode(size, wire.BLOCK_RESPONSE, node)
            if reply is not None and len(reply.data) == length:
                return reply.data
        return None

    def write_quadlet(self, node: int, address: int, value: int, flags: int = 0) -> bool:
        """Write one register of a node; False when the datagram could not be sent."""
        return self.send(wire.quadlet_write(node, address, value, self.next_tl(), self.generation, flags))

    def pause(self, milliseconds: int) -> None:
        """Let the boards do their work; late replies stay queued. Nothing to wait for when time is simulated."""
        if self.real_time:
            select.poll().poll(milliseconds)

    def _decode(self, size: int, tcode: int, node: int) -> wire.Response | None:
        if size <= 0:
            return None
        try:
            reply = wire.decode_response(self.rx[:size])
        except wire.WireError:
            reply = None
        if isinstance(reply, wire.Response) and reply.tcode == tcode and node in (reply.node, wire.BROADCAST):
            return reply
        self.counters.stray += 1
        return None

    def _open_socket(self) -> socket.socket:
        if self._socket is None:
            raise self._closed()
        return self._socket

    def _closed(self) -> PortError:
        return PortError("the port is closed", self.where, "open it first")
