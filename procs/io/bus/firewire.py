"""FireWire to the controllers of a bus, through the character devices of the kernel (/dev/fw*), one for each node.

Requests and replies have the form they have over Ethernet, so all layers above are the same; here they become ioctls
and events. Requests to all boards are sent as original hosts send them, for which the firmware is made: some cards read
nothing more after a real broadcast, so a query and the commands of all boards are addressed to node 0, and every board
takes them. They are broadcast only where node 0 is no board. Other registers of all boards are written board by board.
"""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import re
import select
import struct
from array import array
from collections import deque
from pathlib import Path
from typing import Final

from trocar.procs.fpga import registers, wire
from trocar.procs.io.bus import cdev as firewire
from trocar.procs.io.bus.transport import PortError, Transport
from trocar.shm.time.clock import monotonic_ns

DEVICES: Final = Path("/dev")
QUERY_OFFSET: Final = 0x1800  # address that the firmware takes for a query of all, though addressed to node 0
COMMAND_OFFSET: Final = 0xFFFF_FFFF_0000  # and for commands to all
REGISTERS: Final = 0xFFFF_FFFF_0000  # boards look at the lower 16 bits only; the kernel broadcasts only up there
LOOK_AGAIN_NS: Final = 100_000_000  # a device appears some time after its board
FOREIGN: Final = -1
AGES: Final = 0xFFFF
NO_ANSWER: Final = 1 << 40  # closures of requests whose outcome is not needed

_REQUEST = struct.Struct(">BBIII")  # flags, generation, q0-q2
_REPLY = struct.Struct(">IIII")
_TRAILER = struct.Struct(">BBxxxxxx")
_READS = (wire.QUADLET_READ, wire.BLOCK_READ)


class LinuxKernel:
    """The system calls needed here; tests replace them."""

    def devices(self) -> list[str]:
        """The devices of all nodes of all cards."""
        return [str(path) for path in DEVICES.glob("fw*") if re.fullmatch(r"fw\d+", path.name)]

    def open(self, path: str) -> int:
        """A file descriptor; OSError."""
        return os.open(path, os.O_RDWR | os.O_NONBLOCK | os.O_CLOEXEC)

    def ioctl(self, fd: int, request: int, argument: bytes | bytearray) -> None:
        """OSError; a bytearray is changed in place."""
        if isinstance(argument, bytearray):
            fcntl.ioctl(fd, request, argument, True)
        else:
            fcntl.ioctl(fd, request, argument)


class FirewireTransport(Transport):
    """A `Transport` over the card with index `place` on this machine (0 is the first)."""

    on_firewire = True

    def __init__(self, place: int, kernel: LinuxKernel | None = None) -> None:
        self.where = f"fw:{place}"
        self.most_write = firewire.BROADCAST_BYTES
        self._place, self._kernel = place, kernel or LinuxKernel()
        self._card, self._generation, self._local = -1, 0, -1  # _local: descriptor of the card itself
        self._paths: dict[str, int] = {}  # known devices: descriptor, or FOREIGN
        self._nodes: dict[int, int] = {}  # of our boards: node to descriptor
        self._descriptors: set[int] = set()
        self._looked_ns = 0
        self._replies: deque[bytes] = deque()
        self._age = 0  # of requests: replies to those of another age are not passed on
        self._data = array("B", bytes(firewire.EVENT_BYTES))
        self._data_at = self._data.buffer_info()[0]
        self.close()

    # -- devices -------------------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Open the devices of the card and of all boards on its bus."""
        self.close()
        self._poller = select.poll()
        try:
            self._card = self._find_card()
            self._look()
            self._stop_cycle_starts()
        except BaseException:
            self.close()
            raise
        # Requests to all that are not addressed to node 0 are broadcast, in packets for the slowest.
        self.most_write = wire.MAX_DATA if 0 in self._nodes else firewire.BROADCAST_BYTES
        self.poll, self.recv_into, self.send = self._poll, self._receive, self._send

    def _find_card(self) -> int:
        """The number of the card with our index; PortError lists the existing ones."""
        cards: set[int] = set()
        forbidden: list[str] = []
        for path in sorted(self._kernel.devices()):
            try:
                fd = self._kernel.open(path)
            except PermissionError:
                forbidden.append(path)
                continue
            except OSError:  # gone meanwhile
                continue
            try:
                card, state, _ = self._ask(fd)
                if state.is_local:
                    cards.add(card)
            except OSError:
                continue
            finally:
                os.close(fd)
        if self._place < len(cards):
            return sorted(cards)[self._place]
        if forbidden:
            raise PortError(f"not permitted to open {', '.join(forbidden)}", self.where,
                            "let the user read and write them (a udev rule for /dev/fw*)")
        counted = f"{len(cards)} FireWire card{'s' if len(cards) > 1 else ''}, counted from 0"
        there = counted if cards else "no FireWire card"
        raise PortError(f"this machine has {there}", self.where,
                        "is the driver firewire-ohci loaded? Without hardware: trocar up FILE --boards emulated")

    def _ask(self, fd: int) -> tuple[int, firewire.BusReset, int]:
        """Card, bus and vendor of a device; from now on the device reports bus resets."""
        rom, state = array("I", bytes(firewire.ROM_BYTES)), array("B", bytes(firewire.RESET_BYTES))
        info = firewire.encode_info(rom.buffer_info()[0], state.buffer_info()[0])
        self._kernel.ioctl(fd, firewire.GET_INFO, info)
        event = firewire.decode_event(state.tobytes())
        if not isinstance(event, firewire.BusReset):
            raise OSError(errno.EPROTO, "no bus")
        return firewire.card_of(info), event, firewire.vendor_of(rom.tobytes())

    def _look(self) -> None:
        """Open new devices: boards, by the vendor in their ROM; other devices are never addressed."""
        self._looked_ns = monotonic_ns()
        there = self._kernel.devices()
        for path in [path for path in self._paths if path not in there]:
            del self._paths[path]
        for path in there:
            if path not in self._paths:
                with contextlib.suppress(OSError):  # gone again, or not accessible yet: tried again later
                    self._open_device(path)

    def _open_device(self, path: str) -> None:
        fd = self._kernel.open(path)
        try:
            card, state, vendor = self._ask(fd)
        except OSError:
            os.close(fd)
            raise
        if card != self._card or not (state.is_local or vendor == firewire.VENDOR):
            os.close(fd)
            self._paths[path] = FOREIGN
            return
        self._paths[path] = fd
        self._descriptors.add(fd)
        self._poller.register(fd, select.POLLIN)
        self._follow(fd, state)

    def _follow(self, fd: int, state: firewire.BusReset) -> None:
        """A device reports its node in this generation."""
        if state.generation != self._generation:
            self._generation = state.generation
            self._nodes.clear()  # the others report soon
        if state.is_local:
            self._local = fd
        else:
            self._nodes[state.node & firewire.NODE_MASK] = fd

    def _lose(self, fd: int) -> None:
        """The node of a device has left the bus for good."""
        self._poller.unregister(fd)
        self._descriptors.discard(fd)
        self._nodes = {node: other for node, other in self._nodes.items() if other != fd}
        self._paths = {path: other for path, other in self._paths.items() if other != fd}
        if fd == self._local:
            self._local = -1
        os.close(fd)

    def _stop_cycle_starts(self) -> None:
        """Stop packets for isochronous traffic, which is not used here; they only delay ours."""
        self._data[:4] = array("B", firewire.CYCLE_MASTER.to_bytes(4, "big"))
        with contextlib.suppress(OSError):  # slower, but harmless
            self._request(self._local, wire.QUADLET_WRITE, firewire.STATE_CLEAR, 4, NO_ANSWER)

    def close(self) -> None:
        """Close all devices; harmless when there are none."""
        for fd in self._descriptors:
            os.close(fd)
        self._descriptors.clear()
        self._paths.clear()
        self._nodes.clear()
        self._replies.clear()
        self._generation, self._local = 0, -1
        self.shut()

    def forget(self) -> bool:
        """The kernel reports for every reply which request it belongs to."""
        self._age = self._age + 1 & AGES
        self._replies.clear()
        return True

    def ask_everybody(self) -> int:
        """No request is needed: the generation of the bus is known."""
        return self._generation & 0xFF

    def aim(self, board: int, firmware: int, *, by_board: bool) -> int:
        """No action: nodes are addressed directly."""
        return 0

    # -- requests ------------------------------------------------------------------------------------------------------

    def _send(self, datagram: wire.Buffer) -> None:
        for fd, what in self._poller.poll(0):  # a board may be gone, or have another node by now
            self._take(fd, what)
        _, generation, q0, _, address = _REQUEST.unpack_from(datagram)
        node, tcode, tl = q0 >> 16 & 0x3F, q0 >> 4 & 0xF, q0 >> 10 & 0x3F
        if tcode in _READS:
            self._read(node, tcode, tl, address, generation, datagram)
            return
        data = datagram[14:18] if tcode == wire.QUADLET_WRITE else datagram[22:-4]
        memoryview(self._data)[: len(data)] = data
        is_current = generation == self._generation & 0xFF
        if node == wire.BROADCAST:
            try:
                self._write_all(tcode, address & 0xFFFF, len(data))
            except OSError:
                if is_current:  # else the next read reports that the bus was reset
                    raise
        elif is_current:  # else the node may be another now: lost, as behind a hub
            self._request(self._descriptor(node), tcode, address, len(data), NO_ANSWER)

    def _read(self, node: int, tcode: int, tl: int, address: int, generation: int, datagram: wire.Buffer) -> None:
        if generation != self._generation & 0xFF:
            self._drop()
            return
        length = 4 if tcode == wire.QUADLET_READ else int.from_bytes(datagram[14:16], "big")
        self._request(self._descriptor(node), tcode, address, length, self._age << 24 | tl << 16 | node << 8 | tcode)

    def _drop(self) -> None:
        """Report a dropped read, as a hub does for a read of another generation."""
        self._replies.append(_TRAILER.pack(wire.DROPPED, self._generation & 0xFF))

    def _write_all(self, tcode: int, address: int, length: int) -> None:
        first = self._nodes.get(0)
        if (tcode, address) not in ((wire.QUADLET_WRITE, registers.QUERY), (wire.BLOCK_WRITE, registers.REAL_TIME)):
            for fd in list(self._nodes.values()):
                self._request(fd, tcode, address, length, NO_ANSWER)
        elif first is not None:
            offset = QUERY_OFFSET if tcode == wire.QUADLET_WRITE else COMMAND_OFFSET
            self._request(first, tcode, offset, length, NO_ANSWER)
        else:
            self._request(self._local, tcode, REGISTERS | address, length, NO_ANSWER, firewire.SEND_BROADCAST_REQUEST)

    def _request(self, fd: int, tcode: int, offset: int, length: int, closure: int,
                 code: int = firewire.SEND_REQUEST) -> None:
        if fd < 0:
            raise OSError(errno.ENODEV, "the card is gone")
        self._kernel.ioctl(fd, code, firewire.encode_request(tcode, length, offset, closure, self._data_at,
                                                             self._generation))

    def _descriptor(self, node: int) -> int:
        if node not in self._nodes and monotonic_ns() - self._looked_ns > LOOK_AGAIN_NS:
            self._look()
        fd = self._nodes.get(node)
        if fd is None:
            raise OSError(errno.ENXIO, f"no board is node {node}")
        return fd

    # -- replies -------------------------------------------------------------------------------------------------------

    def _poll(self, timeout_ms: int) -> bool:
        """Wait for a reply; other events of the devices are recorded."""
        deadline_ns = monotonic_ns() + timeout_ms * 1_000_000
        while not self._replies:
            left_ms = max(0, -(-(deadline_ns - monotonic_ns()) // 1_000_000))
            ready = self._poller.poll(left_ms)
            for fd, what in ready:
                self._take(fd, what)
            if not ready and not left_ms:
                break
        return bool(self._replies)

    def _take(self, fd: int, what: int) -> None:
        try:
            data = os.read(fd, firewire.EVENT_BYTES) if what & select.POLLIN else b""
        except OSError as error:
            if error.errno == errno.EAGAIN:
                return
            data = b""
        if not data:
            self._lose(fd)
            return
        event = firewire.decode_event(data)
        if isinstance(event, firewire.BusReset):
            self._follow(fd, event)
            self._paths = {path: other for path, other in self._paths.items() if other != FOREIGN}  # names are reused
            self._looked_ns = 0
        elif isinstance(event, firewire.CdevResponse) and event.closure != NO_ANSWER:
            self._answer(event)

    def _answer(self, event: firewire.CdevResponse) -> None:
        """Build the reply as over Ethernet; none if the node did not answer."""
        if event.closure >> 24 != self._age:
            return
        if event.code == firewire.STALE_GENERATION:
            self._drop()
        if event.code != firewire.COMPLETE:
            return
        tl, node, tcode = event.closure >> 16 & 0xFF, event.closure >> 8 & 0xFF, event.closure & 0xFF
        data, trailer = event.data, _TRAILER.pack(0, self._generation & 0xFF)
        if len(data) != 4 if tcode == wire.QUADLET_READ else len(data) > wire.MAX_DATA:
            return  # not an answer to our request
        head = wire.HOST_ID << 16 | tl << 10 | (tcode + 2) << 4  # a response's code is its request's plus 2
        source = (0xFFC0 | node) << 16
        if tcode == wire.QUADLET_READ:
            self._replies.append(_REPLY.pack(head, source, 0, int.from_bytes(data, "big")) + bytes(4) + trailer)
        else:
            self._replies.append(b"".join((_REPLY.pack(head, source, 0, len(data) << 16), bytes(4), data, bytes(4),
                                           trailer)))

    def _receive(self, buffer: memoryview) -> int:
        if not self._replies:
            return 0
        reply = self._replies.popleft()
        buffer[: len(reply)] = reply
        return len(reply)
