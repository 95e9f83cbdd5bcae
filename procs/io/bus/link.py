"""Transactions with the boards of a bus: labels, bus generation, deadlines, late replies, retries of setup reads."""

from __future__ import annotations

import contextlib
import secrets
import select
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from trocar.procs.fpga import wire
from trocar.procs.io.bus.transport import MAX_QUEUED, Transport
from trocar.procs.native.bus_fields import NOTHING, UNREADABLE

Quads: TypeAlias = NDArray[np.uint32]

DATAGRAM_BYTES: Final = 4096  # more than any board sends
CYCLE_TIMEOUT_MS: Final = 2
SETUP_TIMEOUT_MS: Final = 20
SIMULATED_TIMEOUT_MS: Final = 500  # time does not advance during a wait; emulated boards report when no reply comes
SIMULATED_SLICE_MS: Final = 50  # a stall of the whole machine costs one slice
SETUP_TRIES: Final = 5
QUADLET_BYTES: Final = 4
MAX_SEQUENCE: Final = 0xFFFF
MAX_MISSING: Final = 32  # labels, of 64, that rest because the reply to their read is missing
QUIET_NS: Final = 10_000_000  # without any reply: boards answer much sooner or not at all

TIMED_OUT: Final = 0
DROPPED: Final = -1


@dataclass(slots=True)
class Counters:
    """Event counts of a port since its boards were discovered; the arrays have one element a board, in row order."""

    boards: int
    reads: int = 0
    writes: int = 0
    bad_reads: int = 0  # cycles without a complete fresh sample
    bad_writes: int = 0
    timeouts: int = 0
    sequence_errors: int = 0  # cycles in which a block answered another query
    dropped: int = 0  # reads that the hub dropped: bus in reset, other generation
    stray: int = 0  # datagrams discarded: late, doubled or broken
    bus_resets: int = 0
    waited_ns: int = 0  # waiting for replies that did not come
    board_bad_reads: NDArray[np.int64] = field(init=False)
    board_timeouts: NDArray[np.int64] = field(init=False)
    board_sequence_errors: NDArray[np.int64] = field(init=False)

    def __post_init__(self) -> None:
        self.board_bad_reads = np.zeros(self.boards, np.int64)
        self.board_timeouts = np.zeros(self.boards, np.int64)
        self.board_sequence_errors = np.zeros(self.boards, np.int64)

    def clear(self) -> None:
        """All counts back to 0, arrays in place."""
        self.reads = self.writes = self.bad_reads = self.bad_writes = self.timeouts = 0
        self.sequence_errors = self.dropped = self.stray = self.bus_resets = self.waited_ns = 0
        for counts in (self.board_bad_reads, self.board_timeouts, self.board_sequence_errors):
            counts.fill(0)


class Link:
    """A transport and the state of its transactions. After a successful receive, the newest reply is in `rx`.

    A bus is Ethernet-only while `by_board`: nodes are board ids, requests are not forwarded, and the generation of the
    unused FireWire bus is ignored.

    A reply is never taken for that to another request. Any irregularity (no reply, a second one, one to another
    request) makes the link suspect, and before the next read the transport forgets all earlier requests. A transport
    that cannot do so has only the labels, which are reused: so labels of missing replies rest.

    When no more labels can rest, the boards are away, and may still answer earlier requests. Then only single reads are
    sent, so that there is little to answer. On a transport that cannot forget, replies count again once a single read
    was answered and no other datagram followed for a while.
    """

    def __init__(self, transport: Transport, now_ns: Callable[[], int], real_time: bool, spin_ns: int = 0) -> None:
        """`spin_ns`: how long to poll for a reply before sleeping until one arrives."""
        self.transport = transport
        self.now_ns = now_ns
        self.real_time = real_time
        self.spin_ns = spin_ns if real_time else 0  # a simulated clock would never end the polling
        self.counters = Counters(0)  # replaced by the port's own
        self.cycle_timeout_ms = CYCLE_TIMEOUT_MS if real_time else SIMULATED_TIMEOUT_MS
        self.by_board = False
        self.flags = 0  # control flags of all requests
        self.generation = 0  # the bus generation our requests carry
        self.seen_generation = 0  # the one the newest reply carried
        self.tl = secrets.randbelow(wire.TL_COUNT)  # of the newest request; the next ones cannot be guessed
        self.sequence = 1 + secrets.randbelow(MAX_SEQUENCE)  # of the newest query
        self.recv_ns = 0
        self.send_ns = 0
        self.rx = memoryview(bytearray(DATAGRAM_BYTES))
        self.rx_quads: Quads = np.frombuffer(self.rx, np.uint32)  # the same bytes: not swapped yet
        self.suspect = True  # replies to earlier requests may come
        self._missing: deque[int] = deque(maxlen=MAX_MISSING)  # labels that rest
        self._forgets = False  # whether the transport did so the last time
        self._alone_ns = self._strays = 0  # when a single read was sent, and the count of stray datagrams then
        self._alone_answered = False

    @property
    def where(self) -> str:
        """The other end, for messages."""
        return self.transport.where

    def open(self) -> None:
        """Open the transport; the state of the bus is unknown."""
        self.transport.open()
        self.by_board, self.flags = False, 0
        self.generation = self.seen_generation = 0
        self.suspect = True
        self._missing.clear()

    def close(self) -> None:
        """Close the transport; harmless when it is closed."""
        self.transport.close()

    def aim(self, board: int, firmware: int, *, by_board: bool) -> int:
        """The hub and the kind of bus are known; returns the address that the hub must have been given, 0 if none."""
        self.by_board = by_board
        self.flags = wire.NO_FORWARD if by_board else 0
        return self.transport.aim(board, firmware, by_board=by_board)

    def next_tl(self) -> int:
        """The label of the next transaction: 1, 2 … 63, 0, 1 …, except those that rest."""
        tl = (self.tl + 1) % wire.TL_COUNT
        while tl in self._missing:
            tl = (tl + 1) % wire.TL_COUNT
        self.tl = tl
        return tl

    def next_sequence(self) -> int:
        """The number of the next query: 1 … 65535, 1 …"""
        self.sequence = sequence = self.sequence % MAX_SEQUENCE + 1
        return sequence

    def ready(self) -> bool:
        """Before a read: make new replies distinguishable from replies to earlier reads. False: skip this read."""
        if not self.suspect:
            return True
        if len(self._missing) < MAX_MISSING:
            self._forgets = self._forget()
        elif not self._is_quiet():
            return False
        self.suspect = False
        return True

    def _is_quiet(self) -> bool:
        """Whether a single read may be sent to boards that are or were away: no late reply has come recently."""
        now_ns, strays = self.now_ns(), self._strays
        if now_ns - self._alone_ns < QUIET_NS:
            return False
        self._alone_ns, self._forgets = now_ns, self._forget()
        self._strays = self.counters.stray
        if self._strays != strays and not self._forgets:  # they still answer earlier requests
            self._alone_answered = False
            return False
        if self._alone_answered:
            self._alone_answered = False
            self._missing.clear()
        return True

    def _believes(self) -> bool:
        """Whether a reply with the newest label answers the newest read, although earlier replies are missing."""
        if self._forgets:
            self._missing.clear()
        elif len(self._missing) == MAX_MISSING:
            self._alone_answered = True
            return False
        return True

    def doubt(self) -> None:
        """The datagram with the newest label was not its reply, which may still come."""
        self._missing.append(self.tl)
        self.suspect = True

    def _forget(self) -> bool:
        """Make the transport forget earlier requests; False: the received replies were discarded, more may come."""
        if self.transport.forget():
            return True
        for _ in range(MAX_QUEUED):
            if not self.transport.poll(0):
                break
            with contextlib.suppress(OSError):
                self.transport.recv_into(self.rx)
            self.counters.stray += 1
        return False

    def send(self, datagram: wire.Buffer) -> bool:
        """Send one datagram; False if the system refused it (closed port, no buffer, no route)."""
        try:
            self.transport.send(datagram)
        except ConnectionRefusedError:
            # The error is about an earlier datagram to a closed port; this one was not sent, and is sent again.
            self.suspect = True
            try:
                self.transport.send(datagram)
            except OSError:
                return False
        except OSError:
            return False
        self.send_ns = self.now_ns()
        return True

    @property
    def misses_none(self) -> bool:
        """Whether no label rests."""
        return not self._missing

    def receive(self, tl: int, timeout_ms: int, begin_ns: int = 0, come: int = NOTHING) -> int:
        """Wait for the reply with label `tl`: its size in `rx`, or TIMED_OUT or DROPPED. Other replies are discarded.

        `begin_ns`: the native library has waited since then, and `come` bytes have arrived in `rx` (UNREADABLE:
        receiving failed; NOTHING: none).
        """
        rx, left_ms, now_ns = self.rx, timeout_ms, self.now_ns()
        if begin_ns:
            left_ms = max(0, timeout_ms - (now_ns - begin_ns) // 1_000_000)
        else:
            begin_ns = now_ns
            if self.spin_ns:
                self._spin(begin_ns + self.spin_ns)
        deadline_ns = begin_ns + timeout_ms * 1_000_000
        for _ in range(MAX_QUEUED):
            size, come = (come if come != NOTHING else self._take(left_ms)), NOTHING
            if size == NOTHING:
                break
            self.recv_ns = now_ns = self.now_ns()
            if size == wire.TRAILER_BYTES:
                self.seen_generation = rx[1]
                self.counters.dropped += 1
                self.doubt()
                return DROPPED
            if size > wire.TRAILER_BYTES and rx[2] >> 2 == tl:
                if self._missing and not self._believes():
                    break
                self.seen_generation = rx[size - 7]
                return size
            if not size and not self.real_time:  # emulated boards report a missing reply this way
                break
            self.counters.stray += 1
            self.suspect = True
            # A simulated clock does not advance meanwhile; there MAX_QUEUED is the bound.
            left_ms = max(0, (deadline_ns - now_ns + 999_999) // 1_000_000)
        self.counters.timeouts += 1
        self.counters.waited_ns += min(self.now_ns() - begin_ns, timeout_ms * 1_000_000)
        self._missing.append(tl)
        self.suspect = True
        return TIMED_OUT

    def _spin(self, until_ns: int) -> None:
        while not self.transport.poll(0) and self.now_ns() < until_ns:
            pass

    def _take(self, timeout_ms: int) -> int:
        """The size of the next datagram, received into `rx`; UNREADABLE, or NOTHING: none in time."""
        transport = self.transport
        if not (transport.poll(timeout_ms) if self.real_time else self._has_come(timeout_ms)):
            return NOTHING
        try:
            return transport.recv_into(self.rx)
        except OSError:  # an ICMP "port unreachable" for an earlier send: treated as silence
            return UNREADABLE

    def _has_come(self, timeout_ms: int) -> bool:
        """Wait for a datagram in simulated time, for as long as this process, and with it the boards, had CPU time."""
        poll, slice_ms = self.transport.poll, min(timeout_ms, SIMULATED_SLICE_MS)
        return any(poll(slice_ms) for _ in range(max(1, -(-timeout_ms // SIMULATED_SLICE_MS))))

    def read_quadlet(self, node: int, address: int, *, flags: int = 0, timeout_ms: int | None = None,
                     tries: int = SETUP_TRIES) -> int | None:
        """One register of a node; None without an answer. Reads have no side effects, so lost ones are repeated."""
        data = self._read(wire.QUADLET_READ, node, address, QUADLET_BYTES, flags, timeout_ms, tries)
        return None if data is None else int.from_bytes(data, "big")

    def read_block(self, node: int, address: int, length: int, *, flags: int = 0, timeout_ms: int | None = None,
                   tries: int = SETUP_TRIES) -> bytes | None:
        """`length` bytes of a node; None without an answer."""
        return self._read(wire.BLOCK_READ, node, address, length, flags, timeout_ms, tries)

    def _read(self, tcode: int, node: int, address: int, length: int, flags: int, timeout_ms: int | None,
              tries: int) -> bytes | None:
        if timeout_ms is None:
            timeout_ms = SETUP_TIMEOUT_MS if self.real_time else SIMULATED_TIMEOUT_MS
        for _ in range(tries):
            self._settle()
            tl = self.next_tl()
            last = tl, self.generation, self.flags | flags
            if not self.send(wire.quadlet_read(node, address, *last) if tcode == wire.QUADLET_READ else
                             wire.block_read(node, address, length, *last)):
                continue
            size = self.receive(tl, timeout_ms)
            if size > 0:
                data = wire.response_data(self.rx[:size], tcode + 2, node)  # the code of a reply
                if data is None:
                    self.counters.stray += 1
                    self.doubt()
                elif len(data) == length:
                    return data
        return None

    def write_quadlet(self, node: int, address: int, value: int, flags: int = 0) -> bool:
        """Write one register of a node; False when the datagram could not be sent."""
        return self.send(wire.quadlet_write(node, address, value, self.next_tl(), self.generation, self.flags | flags))

    def pause(self, milliseconds: int) -> None:
        """Give the boards time; late replies stay queued. No pause in simulated time."""
        if self.real_time:
            select.poll().poll(milliseconds)

    def _settle(self) -> None:
        """Before a repeated read with a long timeout: discard everything received so far."""
        if self.suspect:
            self._forgets = self._forget()
            self._missing.clear()
