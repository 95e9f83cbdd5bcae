"""The kernel's FireWire devices as the port sees them, with emulated controllers behind them.

What the kernel demands is demanded here: the generation of requests, sizes, what may be broadcast. Card 0 has the
controllers, somebody else's disk and this computer, card 1 nothing.
"""

from __future__ import annotations

import ctypes
import errno
import os
import socket
import struct
from collections.abc import Callable

from tests.fpga import board_side
from tests.io.emulated_ports import PortBench
from trocar.procs.fpga import wire
from trocar.procs.io.bus import cdev as firewire
from trocar.procs.io.bus.firewire import FirewireTransport

CARD, OTHER_CARD, DISK = "/dev/fw0", "/dev/fw1", "/dev/fw2"
LOCAL_BUS = 0xFFC0
OURS, THEIRS = 0xFA610E, 0x00A0B0
ADDRESS_ERROR = 7
BROADCAST_LEAST_OFFSET = 0xFFFF_F000_0800  # below, the kernel broadcasts nothing


def encoded(event: firewire.Event) -> bytes:
    """The event as the kernel encodes it. It repeats the data of short reads: an old error that programs rely on."""
    if isinstance(event, firewire.BusReset):
        managers = (LOCAL_BUS,) * 3
        return firewire._RESET.pack(0, firewire.BUS_RESET, event.node, event.local_node, *managers, event.generation)
    head = firewire._RESPONSE.pack(event.closure, firewire.RESPONSE, event.code, len(event.data))
    room, data = -len(head) % 8, event.data
    return head + (data.ljust(room, b"\0") + data if len(data) <= room else data + bytes(room))


class FakeFirewire(PortBench):
    """A `PortBench` whose port is fw. With `first` this computer is node 0 and the controllers follow."""

    def __init__(self, *, first: bool = False, count: int = 3) -> None:
        super().__init__("fw", count=count, serve=False)
        self.name = "fw"
        self._shift = 1 if first else 0
        self.kernel_generation = 40
        self.forbidden: set[str] = set()
        self.broadcasts: list[tuple[int, int]] = []  # node, offset
        self.touched: set[str] = set()  # devices that a request was sent to
        self.spoil: Callable[[bytes], bytes] = lambda data: data  # what nodes answer to reads
        self._clients: dict[int, tuple[str, socket.socket]] = {}  # by descriptor
        self._gone: set[int] = set()
        self._label = 0
        self._waiting: dict[int, tuple[int, socket.socket]] = {}  # closure and client of reads, by label

    def __exit__(self, *_: object) -> None:
        for _, end in self._clients.values():
            end.close()

    def transport(self) -> FirewireTransport:
        return FirewireTransport(0, self)

    # -- nodes ---------------------------------------------------------------------------------------------------------

    def _nodes(self) -> dict[str, int]:
        """Devices of card 0, by path; controllers are counted along the cable."""
        there = [board for board in self.ids if board not in self._gone]
        nodes = {f"/dev/fw{10 + board}": place + self._shift for place, board in enumerate(there)}
        nodes[DISK] = len(there) + self._shift
        nodes[CARD] = 0 if self._shift else len(there) + 1
        return nodes

    def _state(self, path: str) -> firewire.BusReset:
        if path == OTHER_CARD:
            return firewire.BusReset(LOCAL_BUS, LOCAL_BUS, 3)
        nodes = self._nodes()
        return firewire.BusReset(LOCAL_BUS | nodes[path], LOCAL_BUS | nodes[CARD], self.kernel_generation)

    # -- what happens --------------------------------------------------------------------------------------------------

    def reset(self) -> None:
        super().reset()
        self._report_reset()

    def take_away(self, board: int, *, gone: bool = True) -> None:
        super().take_away(board, gone=gone)
        (self._gone.add if gone else self._gone.discard)(board)
        for fd, (path, end) in list(self._clients.items()):
            if path not in self.devices():
                end.close()
                del self._clients[fd]
        self._report_reset()

    def _report_reset(self) -> None:
        self.kernel_generation += 1
        for path, end in self._clients.values():
            if path != OTHER_CARD:
                self._report(end, encoded(self._state(path)))

    @staticmethod
    def _report(end: socket.socket, event: bytes) -> None:
        try:
            end.send(event)
        except OSError:  # the client has closed it
            end.close()

    # -- the kernel ----------------------------------------------------------------------------------------------------

    def devices(self) -> list[str]:
        return [OTHER_CARD, *self._nodes()]

    def open(self, path: str) -> int:
        if path in self.forbidden:
            raise PermissionError(errno.EACCES, "Permission denied", path)
        if path not in self.devices():
            raise FileNotFoundError(errno.ENOENT, "No such file", path)
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.setblocking(False)
        fd = theirs.detach()
        os.set_blocking(fd, False)
        old = self._clients.pop(fd, None)
        if old is not None:
            old[1].close()
        self._clients[fd] = (path, ours)
        return fd

    def ioctl(self, fd: int, request: int, argument: bytes | bytearray) -> None:
        if fd not in self._clients:
            raise OSError(errno.ENODEV, "No such device")
        path, end = self._clients[fd]
        if request == firewire.GET_INFO:
            self._inform(path, argument)
            return
        tcode, length, offset, closure, data_at, generation = firewire._REQUEST.unpack(argument)
        if request == firewire.SEND_BROADCAST_REQUEST:
            self._check(tcode in (0, 1), errno.EINVAL)
            self._check(offset >= BROADCAST_LEAST_OFFSET, errno.EACCES)
            self._check(length <= 512, errno.EIO)
            node = wire.BROADCAST
        else:
            assert request == firewire.SEND_REQUEST, hex(request)
            self._check(tcode in (0, 1, 4, 5), errno.EINVAL)
            self._check(length <= 2048, errno.EIO)
            node = self._nodes().get(path, 0)
        data = ctypes.string_at(data_at, length) if tcode in (0, 1) else b""
        self.touched.add(path)
        if generation != self.kernel_generation:
            self._report(end, encoded(firewire.CdevResponse(closure, firewire.STALE_GENERATION)))
            return
        code = self._done(path, node, tcode, offset, length, data, closure, end)
        if code is not None:
            self._report(end, encoded(firewire.CdevResponse(closure, code)))

    @staticmethod
    def _check(good: bool, error: int) -> None:
        if not good:
            raise OSError(error, os.strerror(error))

    def _inform(self, path: str, argument: bytes | bytearray) -> None:
        version, room, rom_at, reset_at, _, _ = struct.unpack("@IIQQQI0Q", argument)
        assert version == firewire.ABI_VERSION
        vendor = OURS if path not in (CARD, OTHER_CARD, DISK) else THEIRS
        rom = struct.pack("@5I", 0x0404_0000, 0x31333934, 0, vendor << 8, 7)
        assert room >= len(rom)
        ctypes.memmove(rom_at, rom, len(rom))
        state = encoded(self._state(path))
        ctypes.memmove(reset_at, state, len(state))
        card = 1 if path == OTHER_CARD else 0
        argument[:] = struct.pack("@IIQQQI0Q", 5, len(rom), rom_at, reset_at, 0, card)

    # -- the bus -------------------------------------------------------------------------------------------------------

    def _done(self, path, node, tcode, offset, length, data, closure, end):
        """Do it; the code of a response without data, None where there is none, or not by now."""
        to_all = node == wire.BROADCAST
        if node == 0 and not self._shift and ((tcode == 0 and offset == 0x1800)
                                              or (tcode == 1 and offset == 0xFFFF_FFFF_0000)):
            to_all = True  # addressed to node 0, and taken by every controller
        if to_all:
            self.broadcasts.append((node, offset))
        elif path in (CARD, OTHER_CARD, DISK):
            return ADDRESS_ERROR if path == DISK else firewire.COMPLETE
        target, generation = wire.BROADCAST if to_all else node - self._shift, self.bus.generation
        if tcode in (0, 1):
            write = (wire.quadlet_write(target, offset & 0xFFFF, int.from_bytes(data, "big"), 0, generation)
                     if tcode == 0 else wire.block_write(target, offset & 0xFFFF, data, 0, generation))
            self.answer(write)
            return firewire.COMPLETE
        self._label = label = (self._label + 1) % wire.TL_COUNT
        self._waiting[label] = closure, end
        read = (wire.quadlet_read(target, offset, label, generation) if tcode == 4
                else wire.block_read(target, offset, length, label, generation))
        for reply in self.answer(read):
            found = board_side.decode_response(reply)
            if isinstance(found, board_side.WireResponse):
                whose, client = self._waiting.get(found.tl, (closure ^ 1 << 16, end))
                self._report(client, encoded(firewire.CdevResponse(whose, firewire.COMPLETE, self.spoil(found.data))))
        return None
