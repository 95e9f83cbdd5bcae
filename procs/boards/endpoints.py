"""The UDP sockets of the emulated buses: datagrams with the kernel's receive time in, replies out."""

from __future__ import annotations

import contextlib
import select
import socket
import struct
import time
from collections.abc import Callable

from procs.lib.document import Bus
from procs.lib.wire import UDP_PORT, Buffer

SO_RCVBUFFORCE, SO_TIMESTAMPNS = 33, 35  # Linux; the socket module has no names for them
RECEIVE_BYTES = 8 << 20  # a burst of a thousand writes must not be lost
DATAGRAM_BYTES = 4096
_STAMP = struct.Struct("@qq")
_ANCILLARY = socket.CMSG_SPACE(_STAMP.size)
_OFFSET_AGE_NS = 1_000_000
_OFFSET_SPAN_NS = 20_000

Answer = Callable[[int, Buffer, int], Buffer | None]


class Endpoints:
    """One socket per bus, bound to the bus's own address."""

    def __init__(self, buses: tuple[Bus, ...], answer: Answer, now_ns: Callable[[], int], simulated: bool) -> None:
        """OSError when an address is taken. Receive times are the kernel's; in lock-step they are `now_ns()`."""
        self._answer, self._now_ns, self._simulated = answer, now_ns, simulated
        self._sockets: list[socket.socket] = []
        try:
            for bus in buses:
                self._sockets.append(_open(bus.address))
        except BaseException:
            self.close()
            raise
        self._numbers = {sock.fileno(): number for number, sock in enumerate(self._sockets)}
        self._files = list(self._numbers)
        self._buffers = [bytearray(DATAGRAM_BYTES) for _ in self._sockets]
        self._views = [memoryview(buffer) for buffer in self._buffers]
        self._offset, self._offset_until = 0, 0

    def serve(self, timeout_ns: int) -> None:
        """Wait at most so long for datagrams; answer one of every socket that has one, in the order they arrived."""
        ready = select.select(self._files, (), (), max(timeout_ns, 0) * 1e-9)[0]
        if len(ready) == 1:
            self._reply(*self._receive(self._numbers[ready[0]]))
        elif ready:
            arrived = sorted((self._receive(self._numbers[file]) for file in ready), key=lambda item: item[2])
            for number, size, stamp, sender in arrived:
                self._reply(number, size, stamp, sender)

    def _receive(self, number: int) -> tuple[int, int, int, object]:
        size, ancillary, _, sender = self._sockets[number].recvmsg_into((self._buffers[number],), _ANCILLARY)
        now = self._now_ns()
        if self._simulated or not ancillary:
            return number, size, now, sender
        seconds, nanoseconds = _STAMP.unpack_from(ancillary[0][2])
        if now >= self._offset_until:
            self._compare_clocks(now)
        return number, size, min(seconds * 1_000_000_000 + nanoseconds - self._offset, now), sender

    def _compare_clocks(self, now: int) -> None:
        """Between the two clocks, taken anew every millisecond: the wall clock may be set at any time."""
        self._offset_until = now + _OFFSET_AGE_NS
        before = time.clock_gettime_ns(time.CLOCK_REALTIME)
        between = self._now_ns()
        after = time.clock_gettime_ns(time.CLOCK_REALTIME)
        if after - before < _OFFSET_SPAN_NS or abs(before - between - self._offset) > _OFFSET_AGE_NS:
            self._offset = (before + after) // 2 - between  # else we were held up, and the old one is better

    def _reply(self, number: int, size: int, stamp_ns: int, sender: object) -> None:
        reply = self._answer(number, self._views[number][:size], stamp_ns)
        if reply is not None:
            with contextlib.suppress(OSError):  # who asked is gone, or its buffer is full: as on a cable, it is lost
                self._sockets[number].sendto(reply, sender)  # type: ignore[call-overload]  # an address as received

    def close(self) -> None:
        """Close the sockets."""
        for sock in self._sockets:
            sock.close()


def _open(address: str) -> socket.socket:
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.setsockopt(socket.SOL_SOCKET, SO_TIMESTAMPNS, 1)
        try:
            sock.setsockopt(socket.SOL_SOCKET, SO_RCVBUFFORCE, RECEIVE_BYTES)
        except PermissionError:
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, RECEIVE_BYTES)
        sock.bind((address, UDP_PORT))
    except OSError as error:
        sock.close()
        raise OSError(error.errno, f"emulated bus on {address}, port {UDP_PORT}: {error.strerror}") from error
    return sock
