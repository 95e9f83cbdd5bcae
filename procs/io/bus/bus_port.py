"""A bus of controllers: finds, checks, samples and commands them over any transport."""

from __future__ import annotations

import dataclasses
from collections import ChainMap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, TypeAlias

import numpy as np

from trocar.procs.fpga import blocks, registers, wire
from trocar.procs.io.bus import discovery
from trocar.procs.io.bus.discovery import BoardInfo
from trocar.procs.io.bus.exchange import Exchange, ExchangeSettings
from trocar.procs.io.bus.link import SETUP_TRIES, Link, Quads
from trocar.procs.io.bus.port import Port
from trocar.procs.io.bus.protocols import (
    BROADCAST_QUERY,
    PROTOCOLS,
    SEQUENTIAL,
    SEQUENTIAL_BROADCAST,
    BroadcastWrite,
    QueryRead,
    SequentialRead,
    SequentialWrite,
    UnaskedRead,
)
from trocar.procs.io.bus.rows import Rows
from trocar.procs.io.bus.transport import PortError, Transport

_Reader: TypeAlias = QueryRead | UnaskedRead | SequentialRead
_Writer: TypeAlias = BroadcastWrite | SequentialWrite
_Found: TypeAlias = tuple[BoardInfo, tuple[BoardInfo, ...]]

ALL_BOARDS: Final = 0x3F  # in place of a board id: every board of the bus
MAX_BLOCK: Final = 1440  # bytes of a manual block transfer, whatever the transport permits


@dataclass(frozen=True, slots=True)
class PortOptions:
    """How a port uses its bus."""

    protocol: str = BROADCAST_QUERY
    bridge: bool = False
    """Over FireWire behind the hub even where the boards could do without."""
    real_time: bool = True
    """False: a simulated clock, which does not advance during a wait; receive deadlines are generous, pauses skipped.
    """
    exclusive: bool = True
    """Refuse a bus that another host is driving."""
    query_wait_ns: int | None = None
    """Time the boards are given between query and read; None: as long as they need."""
    deadline_ms: int | None = None
    """How long a cyclic read waits for its reply; None: 2 ms (0.5 s when simulated)."""
    first_control: int = 0
    """Written to the status register of all boards as soon as the bus is known to be ours, before the boards are
    checked (io: power off, whatever the previous process left).
    """
    quiet: bool = False
    """Find the boards by reads alone where an earlier host left them ready: writes, even those of discovery, refresh
    the watchdogs.
    """
    spin_ns: int = 0
    """How long to poll for a reply before sleeping until one arrives."""
    unknown_firmware: bool = False
    """Also write to boards whose layout is only assumed; otherwise nothing is written to their bus after discovery
    (`read_only`). Either way they must send blocks of that layout.
    """


USUAL: Final = PortOptions()


class BusPort(Port):
    """A bus with its boards. `board_ids` may come in any order; array rows are the boards in ascending id.

    `now_ns` is the clock of all stamps, CLOCK_MONOTONIC where it is real. Without board ids (tools), all boards that
    are found are listed, and cyclic reads and writes are not possible.
    """

    def __init__(self, transport: Transport, board_ids: Sequence[int], now_ns: Callable[[], int],
                 options: PortOptions = USUAL) -> None:
        super().__init__(board_ids, now_ns)
        where, protocol = f"port {transport.where}", options.protocol
        wrong = [b for b in self.board_ids if not 0 <= b <= 15]
        if wrong or len(set(self.board_ids)) != len(self.board_ids):
            raise PortError(f"board ids {list(board_ids)}", where, "allowed: each once, 0 to 15")
        if protocol not in PROTOCOLS:
            raise PortError(f"protocol {protocol!r}", where, f"allowed: {', '.join(PROTOCOLS)}")
        self._options = options
        self._hub: BoardInfo | None = None
        self.bad = np.zeros(len(self.board_ids), np.bool_)  # boards without a sample in the last read
        self.boards: tuple[BoardInfo, ...] = ()
        self._link = Link(transport, now_ns, options.real_time, options.spin_ns)
        self._link.counters = self.counters
        self._link.cycle_timeout_ms = options.deadline_ms or self._link.cycle_timeout_ms
        self._nodes: ChainMap[int, int] = ChainMap()
        self._reader: _Reader | None = None
        self._writer: _Writer | None = None

    def open(self) -> None:
        """Open the transport."""
        self._link.open()

    def close(self) -> None:
        """Close the transport; boards keep their last command until their watchdog trips."""
        self._link.close()
        self._reader = self._writer = self.exchange = None

    @property
    def stranger(self) -> str:
        """ADDRESS:PORT of the unknown sender of the newest ignored datagram; empty: there was none."""
        return self._link.transport.stranger

    def __enter__(self) -> BusPort:
        self.open()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def discover(self) -> tuple[BoardInfo, ...]:
        """Find the hub and all boards, check them, and get ready to read and write."""
        link = self._link
        self.close()
        link.open()
        if link.transport.on_firewire:
            hub, boards = self._find_on_firewire()
        else:
            hub, boards = (self._find_reported() if self._options.quiet else None) or self._find_by_network()
        self.boards, self._hub = boards, hub
        self._nodes = ChainMap({info.board: info.node for info in boards})
        if self.board_ids:
            self._prepare(hub)
        self.away[...] = False
        self.counters.clear()  # silent node numbers are no faults
        return boards

    def _find_by_network(self) -> _Found:
        link = self._link
        hub = discovery.find_hub(link, self._options.bridge)
        self._make_ours(hub)
        boards = discovery.find_boards(link, hub.board, self.board_ids)
        discovery.check_boards(link, boards, self.board_ids)
        if hub.board not in {info.board for info in boards}:
            raise PortError(f"hub board {hub.board} has no FireWire node number", link.where, "check its FireWire")
        if not link.by_board:
            discovery.tune_gap(link, boards)
        return hub, boards

    def _find_reported(self) -> _Found | None:
        """None if the hub does not have our address, or the boards do not know their node numbers yet."""
        link = self._link
        hub = discovery.find_reported_hub(link, self._options.bridge)
        if hub is None:
            return None
        boards = discovery.find_boards(link, hub.board, self.board_ids)
        discovery.check_boards(link, boards, self.board_ids)
        return (hub, boards) if hub.board in {info.board for info in boards} else None

    def _find_on_firewire(self) -> _Found:
        hub, boards = discovery.find_on_firewire(self._link, self.board_ids)
        self._make_ours(hub)
        discovery.check_boards(self._link, boards, self.board_ids)
        return hub, boards

    def _make_ours(self, hub: BoardInfo) -> None:
        """PortError if another host drives the bus; else switch off everything that the previous process left on."""
        if self._options.exclusive and self.board_ids:
            discovery.refuse_other_host(self._link, hub)
        if self._options.first_control:
            self._link.write_quadlet(wire.BROADCAST, registers.STATUS, self._options.first_control)

    def refuse_other_host(self) -> None:
        """PortError while another host drives the bus. The check samples the hub, which restarts its sample timer."""
        if self._hub is None:
            raise self._not_ready()
        discovery.refuse_other_host(self._link, self._hub)

    def _prepare(self, hub: BoardInfo) -> None:
        known = {info.board: info for info in self.boards}
        wanted_boards = [known[board] for board in self.board_ids]
        layouts = tuple(blocks.layout_of(info.firmware, *blocks.AXES_OF[info.hardware]) for info in wanted_boards)
        self._check_size(layouts)
        width = max(max(layout.motors, layout.encoders) for layout in layouts)
        if width != self.columns.width:
            self._make_rows(width)
        self.hardware = tuple(info.hardware for info in wanted_boards)
        wanted = {board: self._nodes[board] for board in {*self.board_ids, hub.board}}
        rows = Rows(self.board_ids, layouts, self.columns, self.blocks, self.out, self.bad, self.away, wanted,
                    hub.board, self._options.query_wait_ns)
        self._nodes = self._nodes.new_child(wanted)  # so that a rescan keeps this part up to date
        self._reader, self._writer = _parts(self._options.protocol, self._link, rows)
        used = {info.board: info for info in (*wanted_boards, hub)}
        self._check_assumed([info for info in used.values() if blocks.LAYOUTS[info.firmware].is_assumed])
        self._make_exchange()

    def _check_assumed(self, assumed: Sequence[BoardInfo]) -> None:
        """PortError unless these boards send blocks of the assumed layout; hub memory gives their sizes."""
        self.assumed, self.read_only = tuple(info.board for info in assumed), ""
        if not assumed:
            return
        who = ", ".join(f"board {info.board}: Rev {info.firmware}" for info in assumed)
        if self._options.protocol != BROADCAST_QUERY:
            raise PortError(f"unknown firmware ({who}), whose blocks {self._options.protocol} cannot check",
                            self._link.where, f"allowed: {BROADCAST_QUERY}")
        if not any(self.read_all() for _ in range(SETUP_TRIES)):
            known = ", ".join(str(number) for number, row in blocks.LAYOUTS.items() if not row.is_assumed)
            raise PortError(f"unknown firmware ({who}) whose real-time blocks are not those of Rev 9", self._link.where,
                            f"allowed: Rev {known}")
        if not self._options.unknown_firmware:
            self.read_only = f"unknown firmware ({who}): the bus is only read, unless io.unknown_firmware is true"

    def _check_size(self, layouts: Sequence[blocks.Layout]) -> None:
        """A command to all boards at once must fit one datagram."""
        transport, sizes = self._link.transport, []
        if self._options.protocol == BROADCAST_QUERY:
            sizes.append(("read", 4 * (sum(layout.hub_quads for layout in layouts) + 1), transport.most_read))
        if self._options.protocol != SEQUENTIAL:
            sizes.append(("write", 4 * sum(layout.write_quads for layout in layouts), transport.most_write))
        for what, needed, limit in sizes:
            if needed > limit:
                raise PortError(f"{len(self.board_ids)} boards do not fit one broadcast {what} ({needed} bytes)",
                                self._link.where, f"allowed: {limit}, or protocol {SEQUENTIAL}")

    def ask_all(self) -> None:
        """Have every board sample, where the protocol has a step for it. The boards sample while the caller works until
        `read_all`.
        """
        if self._reader is None:
            raise self._not_ready()
        self._reader.ask()

    def read_all(self) -> bool:
        """Sample every board that is not `away` into `blocks`; False if one fails, then `blocks` is unchanged.

        Queries the boards first if `ask_all` was not called.
        """
        if self._reader is None:
            raise self._not_ready()
        counters = self.counters
        good = self._reader.read()
        self.recv_ns = self._link.recv_ns
        counters.reads += 1
        if not good:
            counters.bad_reads += 1
        return good

    def set_exchange(self, settings: ExchangeSettings) -> None:
        """Have `exchange` do io's halves with these settings from now on, where the native library can."""
        super().set_exchange(settings)
        self._make_exchange()

    def _make_exchange(self) -> None:
        """Possible with one query to all boards, one write to all, and the machine's clock."""
        reader, writer, settings = self._reader, self._writer, self.settings
        if (settings is not None and self._link.real_time and isinstance(reader, QueryRead)
                and not self.read_only and isinstance(writer, BroadcastWrite)):
            self.exchange = Exchange(self._link, reader, writer, settings)

    def write_all(self) -> bool:
        """Send `out` to every board, also after a bad read (the write feeds the watchdogs), then zero its control
        words.
        """
        if self._writer is None:
            raise self._not_ready()
        if self.read_only:
            self.out[:, -1] = 0
            return super().write_all()
        counters = self.counters
        good = self._writer.write()
        self.send_ns = self._link.send_ns
        counters.writes += 1
        if not good:
            counters.bad_writes += 1
        return good

    def read_quadlet(self, board: int, address: int) -> int:
        """One register of one board; waits up to 0.1 s, so for setup and tools. PortError without an answer."""
        value = self._link.read_quadlet(self._node(board), address)
        if value is None:
            raise self._no_answer(board, address)
        return value

    def write_quadlet(self, board: int, address: int, value: int) -> None:
        """Write one register of one board, or of `ALL_BOARDS`, without acknowledgement; nothing if `read_only`."""
        if self.read_only:
            return
        node = wire.BROADCAST if board == ALL_BOARDS else self._node(board)
        if not self._link.write_quadlet(node, address, value):
            raise self._not_sent(board, address)

    def read_block(self, board: int, address: int, quads: int) -> Quads:
        """This many consecutive quadlets of one board, (quads,)."""
        most = min(MAX_BLOCK, self._link.transport.most_read) // 4
        if not 2 <= quads <= most:
            raise PortError(f"block of {quads} quadlets", f"board {board}", f"allowed: 2 to {most}")
        data = self._link.read_block(self._node(board), address, 4 * quads)
        if data is None:
            raise self._no_answer(board, address)
        return np.frombuffer(data, np.dtype(">u4")).astype(np.uint32)

    def peek(self, board: int, address: int, quads: int = 1) -> Quads | None:
        """Quadlets of one board, read once between two cycles; None without an answer within a cycle."""
        link, node = self._link, self._node(board)
        if quads > 1:
            data = link.read_block(node, address, 4 * quads, timeout_ms=link.cycle_timeout_ms, tries=1)
            return None if data is None else np.frombuffer(data, np.dtype(">u4")).astype(np.uint32)
        value = link.read_quadlet(node, address, timeout_ms=link.cycle_timeout_ms, tries=1)
        return None if value is None else np.array([value], np.uint32)

    def write_block(self, board: int, address: int, values: Sequence[int]) -> None:
        """Write consecutive quadlets of one board; nothing if `read_only`."""
        if self.read_only:
            return
        node = wire.BROADCAST if board == ALL_BOARDS else self._node(board)
        data = np.asarray(values, np.uint32).astype(np.dtype(">u4")).tobytes()
        link = self._link
        most = min(MAX_BLOCK, link.transport.most_write) // 4
        if not 2 <= len(values) <= most:
            raise PortError(f"block of {len(values)} quadlets", f"board {board}", f"allowed: 2 to {most}")
        if not link.send(wire.block_write(node, address, data, link.next_tl(), link.generation, link.flags)):
            raise self._not_sent(board, address)

    def info(self, board: int) -> BoardInfo:
        """What discovery found about a board; PortError if it was not discovered."""
        node = self._node(board)
        return next(dataclasses.replace(info, node=node) for info in self.boards if info.board == board)

    def _node(self, board: int) -> int:
        node = self._nodes.get(board)
        if node is None:
            there = ", ".join(map(str, sorted(self._nodes))) or "none yet (discover first)"
            raise PortError(f"no board {board}", self._link.where, f"boards on this bus: {there}")
        return node

    def _not_sent(self, board: int, address: int) -> PortError:
        return PortError(f"write to register 0x{address:04X} could not be sent", f"{self._link.where} board {board}",
                         "check the network")

    def _no_answer(self, board: int, address: int) -> PortError:
        return PortError(f"register 0x{address:04X} is not answered", f"{self._link.where} board {board}",
                         "check its power and cables")

    def _not_ready(self) -> PortError:
        return PortError("the boards are not discovered", self._link.where, "open and discover first")


def _parts(protocol: str, link: Link, rows: Rows) -> tuple[_Reader, _Writer]:
    """Reader and writer of a protocol (one of PROTOCOLS)."""
    if protocol == SEQUENTIAL:
        return SequentialRead(link, rows), SequentialWrite(link, rows)
    if protocol == SEQUENTIAL_BROADCAST:
        return SequentialRead(link, rows), BroadcastWrite(link, rows)
    return (UnaskedRead if link.by_board else QueryRead)(link, rows), BroadcastWrite(link, rows)
