"""One native call from the boards' reply to the write that answers it, system calls included.

The call handles normal cycles only. Any other datagram is left to `Link.receive`, and a failed write to the caller, as
without this module.
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
from trocar.procs.native.library import bind
from trocar.procs.native.progress import BAD, NONE, READY, SENT

HEAD_BYTES: Final = 22  # of a block write, before its data
GENERATION_AT: Final = -7  # bytes from the end of a reply: the bus generation


@dataclass(frozen=True, slots=True)
class ExchangeSettings:
    """What io does with a sample in the call that receives it; fixed for the life of a `BusPort`."""

    stages: BoundStruct
    """The arrays of io's stages for the native library."""
    oldest_ns: int
    """Upper bound of sample intervals in their mean; see procs/io/cycle.py for all three."""
    stable_ns: float
    gaps: float


class Exchange:
    """The native call for one reader and one writer; its arrays are bound again when the boards on the bus change."""

    def __init__(self, link: Link, reader: QueryRead, writer: BroadcastWrite, settings: ExchangeSettings) -> None:
        self._link, self._reader, self._writer = link, reader, writer
        self._settings, self.io = settings, settings.stages.address
        self.oldest_ns, self.stable_ns, self.gaps = settings.oldest_ns, settings.stable_ns, settings.gaps
        self.came = np.zeros(3, np.int64)
        """Size and time of the reply, and time of the write."""
        self._came = self.came.data
        self._made_for: object = None
        self._parts: tuple[BoundStruct, ...] = ()  # their addresses are known to the native library
        self._answer: Callable[..., int] | None = None

    def _prepare(self) -> None:
        """Prepare for another bus generation, hub or set of boards: rare."""
        reader, groups = self._reader, self._writer.groups
        self._made_for = reader.made_for
        heads = b"".join(self._writer.heads())
        self.labels, self.head_bytes = len(heads) // HEAD_BYTES, HEAD_BYTES
        self.heads = np.frombuffer(heads, np.uint8).reshape(self.labels, self.head_bytes)
        self.data_bytes, self.reply_bytes, self.hub_node = reader.blocks.length, reader.blocks.size, reader.hub_node
        found, sent = bind(HUB, reader.blocks), bind(WRITE, groups)
        self._answer = None
        if isinstance(found, BoundStruct) and isinstance(sent, BoundStruct):
            self.hub_address, self.write_address = found.address, sent.address
            bound = bind(EXCHANGE, self)
            if isinstance(bound, BoundStruct):
                self._parts, self._answer = (found, sent), bound.function("answer")

    def answer(self, good_ns: int, wake_ns: int, over_ns: int, gap_ns: float) -> int:
        """See `BusPort.answer`."""
        link, reader = self._link, self._reader
        tl, timeout_ms = reader.request(), link.cycle_timeout_ms
        if tl == UNSENT:
            return BAD
        if self._made_for is not reader.made_for:
            self._prepare()
        fd, call = link.transport.fd, self._answer
        if call is None or fd < 0 or not link.misses_none:  # else the label alone does not identify the reply
            return NONE if reader.take(link.receive(tl, timeout_ms)) else BAD
        begin_ns = link.send_ns
        done = call(fd, tl, link.next_tl(), timeout_ms, link.spin_ns, good_ns, wake_ns, over_ns, gap_ns)
        if done != SENT:
            link.tl = tl  # no label was used for a write
        size, received_ns, sent_ns = self._came
        if done == BAD:
            return NONE if reader.take(link.receive(tl, timeout_ms, begin_ns, size)) else BAD
        link.recv_ns = received_ns
        link.seen_generation = link.rx[size + GENERATION_AT]
        reader.has_taken(True)
        if done == SENT:
            link.send_ns = sent_ns
        elif done == READY:  # delayed, or refused, perhaps because an earlier datagram met a closed port
            link.suspect = True
        return done
