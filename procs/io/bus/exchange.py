"""The halves of io's cycle (procs/io/halves.py) with their system calls, as native calls: one where Python has nothing
to decide between them, else two.

They handle the reply to the newest read only. Any other datagram is left to `Link.receive`, and a failed write to the
caller, as without this module.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from trocar.procs.io.bus.link import Link
from trocar.procs.io.bus.protocols import UNSENT, BroadcastWrite, QueryRead
from trocar.procs.native.bound import BoundStruct
from trocar.procs.native.bus_fields import EXCHANGE, HUB, WRITE
from trocar.procs.native.io_fields import CONTROLLED, IO, MISSED, SENT
from trocar.procs.native.library import bind

HEAD_BYTES: Final = 22  # of a block write, before its data
GENERATION_AT: Final = -7  # bytes from the end of a reply: the bus generation
SENT_NS: Final = 2  # element of `Exchange.came`


@dataclass(frozen=True, slots=True)
class ExchangeSettings:
    """How io uses a sample; fixed for the life of a `BusPort`, see procs/io/cycle.py."""

    halves: BoundStruct
    """The arrays of io's halves for the native library."""
    oldest_ns: int
    """Upper bound of sample intervals in their mean."""
    stable_ns: float
    gaps: float


class Exchange:
    """The native calls for one reader and one writer; their arrays are bound again when the boards on the bus change.
    """

    def __init__(self, link: Link, reader: QueryRead, writer: BroadcastWrite, settings: ExchangeSettings) -> None:
        self.link, self._reader, self._writer, self.settings = link, reader, writer, settings
        self._check, self._encode, _ = (settings.halves.function(name) for name in IO.functions)
        self.io = settings.halves.address
        self.came = np.zeros(3, np.int64)
        """Size and time of the reply, and time of the write."""
        self._came = self.came.data
        self._made_for: object = None
        self._parts: tuple[BoundStruct, ...] = ()  # their addresses are known to the native library
        self._generation = -1
        """Bus generation of the prepared writes."""
        self._receive: Callable[..., int] | None = None
        self._send: Callable[..., int] | None = None

    def _prepare(self) -> None:
        """Prepare for another bus generation, hub or set of boards: rare."""
        reader, groups = self._reader, self._writer.groups
        self._made_for, self._generation = reader.made_for, self.link.generation
        heads = b"".join(self._writer.heads())
        self.labels, self.head_bytes = len(heads) // HEAD_BYTES, HEAD_BYTES
        self.heads = np.frombuffer(heads, np.uint8).reshape(self.labels, self.head_bytes)
        self.data_bytes, self.reply_bytes, self.hub_node = reader.blocks.length, reader.blocks.size, reader.hub_node
        found, sent = bind(HUB, reader.blocks), bind(WRITE, groups)
        self._receive = self._send = None
        if isinstance(found, BoundStruct) and isinstance(sent, BoundStruct):
            self.hub_address, self.write_address = found.address, sent.address
            bound = bind(EXCHANGE, self)
            if isinstance(bound, BoundStruct):
                self._parts = (found, sent)
                self._receive, self._send = (bound.function(name) for name in EXCHANGE.functions)

    def receive_and_check(self, good_ns: int, wake_ns: int, over_ns: int, gap_ns: float) -> int:
        """Bits of `Halves.receive_and_check`. After `over_ns`, on CLOCK_BOOTTIME, nothing is sent."""
        link, reader = self.link, self._reader
        tl, timeout_ms = reader.request(), link.cycle_timeout_ms
        if tl == UNSENT:
            return MISSED
        if self._made_for is not reader.made_for:
            self._prepare()
        fd, receive = link.transport.fd, self._receive
        if receive is None or fd < 0 or not link.misses_none:  # else the label alone does not identify the reply
            return self._check() if reader.take(link.receive(tl, timeout_ms)) else MISSED
        begin_ns = link.send_ns
        bits = receive(fd, tl, link.next_tl(), timeout_ms, link.spin_ns, good_ns, wake_ns, over_ns, gap_ns)
        size, received_ns, sent_ns = self._came
        if not bits & SENT:
            link.tl = tl  # no label was used for a write
        if bits & MISSED:
            return self._check() if reader.take(link.receive(tl, timeout_ms, begin_ns, size)) else MISSED
        link.recv_ns = received_ns
        link.seen_generation = link.rx[size + GENERATION_AT]
        reader.has_taken(True)
        if bits & SENT:
            link.send_ns = sent_ns
        elif bits & CONTROLLED:  # delayed, or refused, perhaps because an earlier datagram met a closed port
            link.suspect = True
        return bits

    def control_and_send(self, share: float, has_sample: bool, over_ns: int) -> int:
        """Bits of `Halves.control_and_send`; without SENT, `BusPort.write_all` has to send the words."""
        link, fd, send = self.link, self.link.transport.fd, self._send
        if send is None or fd < 0 or link.generation != self._generation:
            return self._encode(share, has_sample)
        before = link.tl
        bits = send(fd, link.next_tl(), share, has_sample, over_ns)
        if bits & SENT:
            link.send_ns = self._came[SENT_NS]
        else:
            link.tl, link.suspect = before, True
        return bits
