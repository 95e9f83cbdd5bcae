"""The sockets of the emulated buses: datagrams with the kernel's receive time in, replies out.

A bridge has one address; with Rev 9 its hub also listens at that plus its board id, the address that hosts use.
Ethernet-only boards each have their own, the bus's plus their board id, and all receive multicast; to let several
systems run side by side in 127/8, multicast is accepted from the bus's own sixteen addresses only. A bus at 0.0.0.0
receives packets for any address of the machine, like the only controllers on a network: boards then have the addresses
that the host assigns.
"""

from __future__ import annotations

import contextlib
import errno
import socket
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass
from ipaddress import IPv4Address
from operator import itemgetter
from typing import Final, cast

from trocar.procs.boards.controllers.bus import GROUP
from trocar.procs.boards.frames import FrameSocket
from trocar.procs.boards.packet_faults import PacketFaults
from trocar.procs.document.system import BusConfig
from trocar.procs.fpga.registers import OWN_ADDRESS
from trocar.procs.fpga.wire import MULTICAST, READS, TCODE_AT, UDP_PORT, Buffer
from trocar.procs.machine.port_holders import holders
from trocar.procs.node.setup_error import SetupError
from trocar.shm.time.lockstep import wait_for_wakeup

SO_RCVBUFFORCE, SO_TIMESTAMPNS, IP_PKTINFO = 33, 35, 8  # Linux; the socket module has no names for them
RECEIVE_BYTES = 8 << 20  # a burst of a thousand writes must not be lost
DATAGRAM_BYTES = 4096
ANY: Final = "0.0.0.0"
RAW: Final = "eth:"  # then a network interface, in place of an address: raw Ethernet
BLOCK: Final = 16  # addresses of an Ethernet-only bus
_STAMP = struct.Struct("@qq")
_PACKET_INFO = struct.Struct("@i4s4s")  # interface, local address, destination
_MEMBERSHIP = struct.Struct("@4s4si")
_ANCILLARY = socket.CMSG_SPACE(_STAMP.size) + socket.CMSG_SPACE(_PACKET_INFO.size)
_STAMP_OF = itemgetter(2)
_OFFSET_AGE_NS = 1_000_000
_OFFSET_SPAN_NS, _OFFSET_TRIES = 20_000, 5

Answer = Callable[[int, Buffer, int, int], Buffer | None]
Addressee = Callable[[int, bytes], int | None]
Sender = tuple[str | bytes, int]  # IP address and port; over raw Ethernet MAC address and the addressed board
# Index of the socket, size, receive time, sender, addressee, source address of the reply (empty: the socket's)
Arrival = tuple[int, int, int, Sender, int, bytes]


@dataclass(slots=True)
class Door:
    """A socket of a bus, and the board that it serves."""

    sock: socket.socket | FrameSocket
    bus: int
    to: int  # board id or GROUP
    replies: socket.socket | FrameSocket  # where replies leave
    only_from: tuple[int, int] | None = None  # accepted senders, as numbers
    any_address: bool = False
    frames: FrameSocket | None = None


class Endpoints:
    """All sockets of the buses."""

    def __init__(self, buses: tuple[BusConfig, ...], answer: Answer, now_ns: Callable[[], int], simulated: bool,
                 packet_faults: PacketFaults | None = None, addressee: Addressee = lambda bus, address: None,
                 wakeup: socket.socket | None = None) -> None:
        """SetupError; OSError when an address cannot be used.

        Receive times are the kernel's; in simulated time they are `now_ns()`.

        `wakeup` ends waiting, too; its data is discarded.

        `addressee` tells which board of a bus at 0.0.0.0 has an address (four bytes); None: none.
        """
        self._answer, self._now_ns, self._simulated = answer, now_ns, simulated
        self._packet_faults, self._addressee = packet_faults or PacketFaults(len(buses)), addressee
        self._wakeup = wakeup
        self._doors: list[Door] = []
        try:
            for number, bus in enumerate(buses):
                self._open(number, bus)
        except BaseException:
            self.close()
            raise
        self._numbers = {door.sock.fileno(): number for number, door in enumerate(self._doors)}
        self._files = list(self._numbers)
        self._buffers = [bytearray(DATAGRAM_BYTES) for _ in self._doors]
        self._views = [memoryview(buffer) for buffer in self._buffers]
        self._offset, self._offset_until = 0, 0

    def _open(self, number: int, bus: BusConfig) -> None:
        if bus.address.startswith(RAW):
            frames = _frames(bus)
            self._doors.append(Door(frames, number, GROUP, frames, frames=frames))
            return
        if bus.network != "ethernet" or bus.address == ANY:
            sock = _bound(bus.address)
            self._doors.append(Door(sock, number, GROUP, sock, any_address=bus.address == ANY))
            if bus.address == ANY:
                sock.setsockopt(socket.IPPROTO_IP, IP_PKTINFO, 1)
                with contextlib.suppress(OSError):  # a machine without multicast: a bridge does without
                    _join(sock, "127.0.0.1")
            elif bus.controllers[0].firmware >= OWN_ADDRESS and bus.controllers[0].board_id:
                own = _bound(str(IPv4Address(int(IPv4Address(bus.address)) + bus.controllers[0].board_id)))
                self._doors.append(Door(own, number, GROUP, own))
            return
        base = int(IPv4Address(bus.address))
        for controller in bus.controllers:
            sock = _bound(str(IPv4Address(base + controller.board_id)))
            self._doors.append(Door(sock, number, controller.board_id, sock))
        group = _bound(MULTICAST, shared=True)
        self._doors.append(Door(group, number, GROUP, self._doors[-len(bus.controllers)].sock, (base, base + BLOCK)))
        _join(group, bus.address)

    def serve(self, timeout_ns: int) -> bool:
        """Wait at most this long for datagrams; answer one of every socket that has one, in the order of arrival.

        Returns whether there was any.
        """
        if self._packet_faults.active:
            timeout_ns = min(timeout_ns, self._packet_faults.next_ns - self._now_ns())
        ready = wait_for_wakeup(self._files, self._wakeup, timeout_ns)
        if len(ready) == 1:
            self._reply(*self._receive(self._numbers[ready[0]]))
        elif ready:
            arrived = [self._receive(self._numbers[file]) for file in ready]
            for arrival in sorted(arrived, key=_STAMP_OF):
                self._reply(*arrival)
        if self._packet_faults.active:
            for _, reply, receiver in self._packet_faults.due(self._now_ns()):
                self._send_to(reply, receiver)
        return bool(ready)

    def _receive(self, number: int) -> Arrival:
        door = self._doors[number]
        size, ancillary, _, sender = door.sock.recvmsg_into((self._buffers[number],), _ANCILLARY)
        now, stamp, to, source = self._now_ns(), 0, door.to, b""
        for _, kind, data in ancillary:
            if kind == SO_TIMESTAMPNS and not self._simulated:
                seconds, nanoseconds = _STAMP.unpack_from(data)
                stamp = seconds * 1_000_000_000 + nanoseconds
            elif kind == IP_PKTINFO and door.any_address:
                _, source, address = _PACKET_INFO.unpack_from(data)
                to = self._board_at(door.bus, address)
        if door.frames is not None:
            to = door.frames.to
        if stamp:
            if now >= self._offset_until:
                self._compare_clocks(now)
            now = min(stamp - self._offset, now)
        return number, size, now, sender, to, source

    def _board_at(self, bus: int, address: bytes) -> int:
        """The addressed board; GROUP for multicast, broadcast and unassigned addresses."""
        found = self._addressee(bus, address)
        return GROUP if found is None else found

    def _compare_clocks(self, now: int) -> None:
        """Offset between the two clocks, measured again every millisecond: the wall clock may be set at any time."""
        self._offset_until = now + _OFFSET_AGE_NS
        for _ in range(_OFFSET_TRIES):
            before = time.clock_gettime_ns(time.CLOCK_REALTIME)
            between = self._now_ns()
            after = time.clock_gettime_ns(time.CLOCK_REALTIME)
            if after - before < _OFFSET_SPAN_NS:
                self._offset = (before + after) // 2 - between
                return
        # else every try was interrupted: keep the old one, unless it is of another clock
        if abs(before - between - self._offset) > _OFFSET_AGE_NS:
            self._offset = (before + after) // 2 - between

    def _reply(self, number: int, size: int, stamp_ns: int, sender: Sender, to: int, source: bytes) -> None:
        door, packet_faults = self._doors[number], self._packet_faults
        if door.only_from is not None and not _heard(str(sender[0]), door.only_from):
            return
        if door.frames is not None and size == 0:
            return
        request, reply = self._views[number][:size], None
        if not packet_faults.active or packet_faults.arrives(door.bus):
            reply = self._answer(door.bus, request, stamp_ns, to)
        if reply is not None and not packet_faults.active:
            self._send(door.replies, reply, sender, source)
            return
        way = (door.replies, sender, source)
        leaving = [] if reply is None else packet_faults.leave(door.bus, reply, way, self._now_ns())
        for data, receiver in leaving:
            self._send_to(data, receiver)
        if self._simulated and not leaving and door.frames is None and _is_read(request):
            self._send(door.replies, b"", sender, source)  # time is stopped: the host could wait indefinitely

    def _send_to(self, reply: Buffer, receiver: object) -> None:
        # as `_reply` gave it to the mishaps
        sock, sender, source = cast(tuple[socket.socket | FrameSocket, Sender, bytes], receiver)
        self._send(sock, reply, sender, source)

    def _send(self, sock: socket.socket | FrameSocket, reply: Buffer, sender: Sender, source: bytes) -> None:
        with contextlib.suppress(OSError):  # the host is gone, or its buffer is full: lost, as on a cable
            if source and isinstance(sock, socket.socket):
                # hosts may refuse a reply from another address than the one they addressed
                where = _PACKET_INFO.pack(0, source, bytes(4))
                sock.sendmsg((reply,), ((socket.IPPROTO_IP, IP_PKTINFO, where),), 0, sender)
            else:
                sock.sendto(reply, sender)

    def close(self) -> None:
        """Close the sockets."""
        for door in self._doors:
            door.sock.close()


def _is_read(request: Buffer) -> bool:
    return len(request) > TCODE_AT and request[TCODE_AT] >> 4 in READS


def _heard(sender: str, block: tuple[int, int]) -> bool:
    return block[0] <= int(IPv4Address(sender)) < block[1]


def _frames(bus: BusConfig) -> FrameSocket:
    interface, ids = bus.address.removeprefix(RAW), [controller.board_id for controller in bus.controllers]
    try:
        frames = FrameSocket(interface, ids, ids[0], by_board=bus.network == "ethernet")
        _prepare(frames)
    except OSError as error:
        raise OSError(error.errno, f"emulated bus on interface {interface}: {error.strerror}") from error
    return frames


def _prepare(sock: socket.socket | FrameSocket) -> None:
    """Times of arrival, and room for a burst."""
    sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
    try:
        sock.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, RECEIVE_BYTES)
    except PermissionError:
        sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BYTES)


def _bound(address: str, *, shared: bool = False) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        _prepare(sock)
        if shared:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        sock.bind((address, UDP_PORT))
    except OSError as error:
        sock.close()
        others = "; ".join(map(str, holders(UDP_PORT, address))) if error.errno == errno.EADDRINUSE else ""
        if others:
            raise SetupError(f"emulated bus on {address}, port {UDP_PORT}: {others}; stop that, or choose an "
                             "address that is free: --set emulation.buses.NAME.address=127.0.1.16") from None
        raise OSError(error.errno, f"emulated bus on {address}, port {UDP_PORT}: {error.strerror}") from error
    return sock


def _join(sock: socket.socket, interface: str) -> None:
    """Receive the controllers' multicast group on the loopback interface."""
    index = socket.if_nametoindex("lo")
    sock.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP,
                    _MEMBERSHIP.pack(socket.inet_aton(MULTICAST), socket.inet_aton(interface), index))
