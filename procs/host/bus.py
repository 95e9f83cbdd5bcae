"""The bus of a host: requests and replies are passed directly to and from the emulated boards, with the same bytes."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from trocar.procs.boards.controllers.bus import GROUP
from trocar.procs.boards.emulation import Emulation
from trocar.procs.fpga import registers, wire
from trocar.procs.io.bus.transport import Transport
from trocar.procs.io.bus.udp import address_of


class DirectTransport(Transport):
    """A transport on which the reply is there when `send` returns."""

    def __init__(self, world: Emulation, bus: int, address: str, now_ns: Callable[[], int]) -> None:
        """Connect to emulated bus number `bus`, whose address between processes would be `address`."""
        self._world, self._bus, self._address, self._now_ns = world, bus, address, now_ns
        self.where = f"bus {bus} of this process"
        self.gives_address = registers.ip_quadlet(address)
        self._replies: deque[bytes] = deque()
        self._by_board = False
        self.send, self.poll, self.recv_into = self._send, self._poll, self._receive

    def open(self) -> None:
        self._replies.clear()

    def close(self) -> None:
        self._replies.clear()

    def forget(self) -> bool:
        self._replies.clear()
        return True

    def ask_everybody(self) -> int:
        self._by_board = False
        return 0

    def aim(self, board: int, firmware: int, *, by_board: bool) -> int:
        self._by_board = by_board
        own = address_of(self._address, board) if firmware >= registers.OWN_ADDRESS else self._address
        return registers.ip_quadlet(own)

    def _send(self, datagram: wire.Buffer) -> None:
        """See Transport; applies packet faults, too."""
        now, faults, bus = self._now_ns(), self._world.packet_faults, self._bus
        to = GROUP
        if self._by_board and (node := datagram[3] & 0x3F) < wire.NODES:
            to = node
        if not faults.active:
            reply = self._world.answer(bus, datagram, now, to)
            if reply is not None:
                self._replies.append(bytes(reply))  # the boards reuse their buffer
            return
        reply = self._world.answer(bus, datagram, now, to) if faults.arrives(bus) else None
        leaving = [] if reply is None else faults.leave(bus, reply, self, now)
        for data, receiver in leaving:
            _reach(receiver, data)
        if not leaving and datagram[wire.TCODE_AT] >> 4 in wire.READS:
            self._replies.append(b"")  # an empty reply, so that the reader does not wait for a lost one forever
        for _, data, receiver in faults.due(now):
            _reach(receiver, data)

    def _poll(self, timeout_ms: int) -> bool:
        """See Transport; does not wait, because no more replies can come."""
        return bool(self._replies)

    def _receive(self, view: memoryview) -> int:
        reply = self._replies.popleft()
        view[: len(reply)] = reply
        return len(reply)


def _reach(receiver: object, data: wire.Buffer) -> None:
    if isinstance(receiver, DirectTransport):
        receiver._replies.append(bytes(data))
