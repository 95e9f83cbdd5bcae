"""Discovery of the hub and the boards behind it, in the order the boards expect (and original hosts use)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from trocar.procs.fpga import blocks, registers, wire
from trocar.procs.fpga.wire import NODES
from trocar.procs.io.bus.link import SETUP_TRIES, Link
from trocar.procs.io.bus.transport import PortError

PHY_PAUSE_MS: Final = 10
FIRST_TRIES: Final = 10
REPORTED_TRIES: Final = 3
SCAN_TIMEOUTS_MS: Final = (20, 40, 100)  # one a pass; later passes only while a wanted board is missing
NOWHERE: Final = 0x3E  # a node number that no board has
PROBE_NS: Final = 1_000_000_000
BUS_ENDS, TURNS = 2, 2  # silent nodes in a row; passes over the bus before a board counts as away
RESCAN_SILENCES: Final = 2  # silent nodes in one cycle: the cost limit of a rescan
OTHER_HOST_PAUSE_MS: Final = 30  # a running host writes at least this often, or its watchdogs trip
OTHER_HOST_LOOKS: Final = 4


@dataclass(frozen=True, slots=True)
class BoardInfo:
    """One controller as discovery found it; `node` is its FireWire node, which a bus reset may change.

    The hub is the board whose hub memory is read: the one with the network cable, if any. Before the nodes are known,
    its `node` is its address; BROADCAST: the hub itself.
    """

    board: int
    node: int
    hardware: str
    firmware: int
    fpga: int
    description: int  # register 0x0F: git description (Rev 8 on), 0 where unreadable
    is_hub: bool


def find_hub(link: Link, bridge: bool) -> BoardInfo:
    """Give the hub its address, take the bus generation from its first reply, and identify the hub."""
    transport = link.transport
    transport.ask_everybody()
    own = 0 if bridge else wire.NO_FORWARD
    if transport.gives_address is not None:
        if not link.write_quadlet(wire.BROADCAST, registers.IP_ADDRESS, transport.gives_address, own):
            raise _silent(link)
        link.pause(transport.pause_ms)
    hardware = link.read_quadlet(wire.BROADCAST, registers.HARDWARE_ID, flags=wire.NO_FORWARD, tries=FIRST_TRIES)
    if hardware is None:
        raise _silent(link)
    link.generation = link.seen_generation
    link.write_quadlet(wire.BROADCAST, registers.PHY_REQUEST, 0, own)
    link.pause(PHY_PAUSE_MS)
    hub = _known_hub(link, hardware, bridge)
    _aim(link, hub, bridge)
    return hub


def find_reported_hub(link: Link, bridge: bool) -> BoardInfo | None:
    """The hub, found by reads alone, which refresh no watchdog; None where no earlier host gave it this address."""
    link.transport.ask_everybody()
    hardware = link.read_quadlet(wire.BROADCAST, registers.HARDWARE_ID, flags=wire.NO_FORWARD, tries=REPORTED_TRIES)
    if hardware is None:
        return None
    link.generation = link.seen_generation
    hub = _known_hub(link, hardware, bridge)
    reported = link.read_quadlet(wire.BROADCAST, registers.IP_ADDRESS, flags=wire.NO_FORWARD)
    address = _aim(link, hub, bridge)
    return hub if address in (0, reported) else None


def _known_hub(link: Link, hardware: int, bridge: bool) -> BoardInfo:
    """Identify the hub."""
    values = []
    for register in (registers.STATUS, registers.FIRMWARE, registers.ETHERNET):
        value = link.read_quadlet(wire.BROADCAST, register, flags=wire.NO_FORWARD)
        if value is None:
            raise PortError(f"the hub does not answer reads of register 0x{register:02X}", link.where,
                            "check the cable")
        values.append(value)
    board, firmware, fpga = registers.board_of(values[0]), values[1], registers.fpga_of(values[2])
    if firmware not in blocks.LAYOUTS:
        raise PortError(f"firmware Rev {firmware} on hub board {board}", link.where, f"allowed: {blocks.REVISIONS}")
    node = board if _does_without_firewire(firmware, fpga, bridge) else wire.BROADCAST
    return BoardInfo(board, node, registers.hardware_name(hardware), firmware, fpga, 0, True)


def _does_without_firewire(firmware: int, fpga: int, bridge: bool) -> bool:
    return fpga == 3 and firmware >= 9 and not bridge


def _aim(link: Link, hub: BoardInfo, bridge: bool) -> int:
    return link.aim(hub.board, hub.firmware, by_board=_does_without_firewire(hub.firmware, hub.fpga, bridge))


def _silent(link: Link) -> PortError:
    return PortError("no controller answers", link.where, "check power, cable and address of the hub")


def find_on_firewire(link: Link, wanted: Sequence[int]) -> tuple[BoardInfo, tuple[BoardInfo, ...]]:
    """All boards of a bus of which this computer is a node, unchecked, and the best one to read hub memory from.

    That is the board that answers a query last: it has received the blocks of all others before.
    """
    link.generation = link.seen_generation = link.transport.ask_everybody()
    boards = find_boards(link, -1, wanted)
    if not boards:
        raise PortError("no controller answers", link.where, "check power and FireWire cables")
    last = [info for info in boards if info.board in wanted or not wanted] or boards
    return last[-1], boards


def find_boards(link: Link, hub: int, wanted: Sequence[int]) -> tuple[BoardInfo, ...]:
    """All boards that answer, by board id, unchecked; `hub` is the id of the one with the network cable."""
    found: dict[int, BoardInfo] = {}  # by node
    for timeout_ms in SCAN_TIMEOUTS_MS:
        for node in range(NODES):
            info = None if node in found else _identify(link, node, hub, timeout_ms)
            if info is not None:
                found[node] = info
        if found and {info.board for info in found.values()}.issuperset(wanted):
            break
    return tuple(sorted(found.values(), key=lambda info: info.board))


def _identify(link: Link, node: int, hub: int, timeout_ms: int) -> BoardInfo | None:
    hardware = link.read_quadlet(node, registers.HARDWARE_ID, timeout_ms=timeout_ms, tries=1)
    if hardware is None:
        return None
    firmware = link.read_quadlet(node, registers.FIRMWARE)
    ethernet = link.read_quadlet(node, registers.ETHERNET)
    status = link.read_quadlet(node, registers.STATUS)
    if firmware is None or ethernet is None or status is None:
        raise PortError(f"node {node} stopped answering", link.where, "check its power and FireWire cables")
    description = link.read_quadlet(node, registers.GIT_DESCRIPTION) or 0
    board = registers.board_of(status)
    return BoardInfo(board, node, registers.hardware_name(hardware), firmware, registers.fpga_of(ethernet), description,
                     board == hub)


def check_boards(link: Link, boards: Sequence[BoardInfo], wanted: Sequence[int]) -> None:
    """Raise PortError for a wanted board that is missing, duplicate or of the wrong kind; without any, for an empty
    bus.
    """
    if not wanted:
        return
    where = link.where
    by_id: dict[int, BoardInfo] = {}
    for info in boards:
        if info.board in by_id:
            nodes = f"nodes {by_id[info.board].node} and {info.node}"
            raise PortError(f"two boards have id {info.board} ({nodes})", where, "set every rotary switch differently")
        by_id[info.board] = info
    missing = [board for board in wanted if board not in by_id]
    if missing:
        there = ", ".join(f"{info.board} (node {info.node})" for info in boards) or "none"
        raise PortError(f"missing: board {', '.join(map(str, missing))}", where, f"boards on this bus: {there}")
    for board in wanted:
        info = by_id[board]
        if info.hardware not in blocks.AXES_OF:
            raise PortError(f"hardware {info.hardware}", f"{where} board {board}",
                            f"allowed: {', '.join(blocks.AXES_OF)}")
        if info.firmware not in blocks.LAYOUTS:
            raise PortError(f"firmware Rev {info.firmware}", f"{where} board {board}", f"allowed: {blocks.REVISIONS}")
        if link.by_board and not _does_without_firewire(info.firmware, info.fpga, bridge=False):
            raise PortError(f"firmware Rev {info.firmware} on FPGA V{info.fpga} needs FireWire",
                            f"{where} board {board}", "allowed: Rev 9 on FPGA V3 for all boards, or udpfw and ethfw")
    revisions = {by_id[board].firmware for board in wanted}
    if 7 in revisions and len(revisions) > 1:
        mix = ", ".join(f"board {board}: Rev {by_id[board].firmware}" for board in wanted)
        raise PortError(f"firmware does not match ({mix})", where, "allowed: all Rev 7, or all later ones")


def tune_gap(link: Link, boards: Sequence[BoardInfo]) -> None:
    """Set all nodes to the smallest safe gap count; the power-up value wastes bus time on every packet."""
    link.write_quadlet(wire.BROADCAST, registers.PHY_REQUEST, 1)
    gaps = set()
    for info in sorted(boards, key=lambda info: info.node):
        answer = link.read_quadlet(info.node, registers.PHY_RESPONSE)
        if answer is None:
            return
        gaps.add(answer & 0x3F)
    if len(gaps) > 1 or registers.GAP_DEFAULT in gaps:
        value = registers.PHY_WRITE | 1 << registers.PHY_REGISTER_SHIFT | registers.gap_count(len(boards))
        link.write_quadlet(wire.BROADCAST, registers.PHY_REQUEST, value)


def refuse_other_host(link: Link, hub: BoardInfo) -> None:
    """Raise PortError if another host samples the boards: the time since the last sample is too short in every try.

    One short time proves nothing: after a delay in a board, the last sample may be one of ours whose reply came too
    late.
    """
    if not link.real_time:
        return
    if _sample(link, hub) is None:
        raise PortError("the hub does not answer real-time reads", link.where, "check its firmware")
    times: list[float] = []
    for _ in range(OTHER_HOST_LOOKS):
        link.pause(OTHER_HOST_PAUSE_MS)
        data = _sample(link, hub, tries=1)
        if data is not None:
            times.append((int.from_bytes(data[:4], "big") + 1) * registers.TICK_S)
            if times[-1] >= OTHER_HOST_PAUSE_MS * 0.9e-3:
                return
    if times:
        raise PortError(f"another host uses this bus (the boards were sampled {times[-1] * 1e3:.1f} ms ago, not by us)",
                        link.where, "allowed: one host; stop the other")


def _sample(link: Link, hub: BoardInfo, tries: int = SETUP_TRIES) -> bytes | None:
    """The real-time block of the hub, before any other node number is known."""
    length = 4 * blocks.read_quads(hub.firmware, *blocks.AXES_OF.get(hub.hardware, blocks.AXES_OF["QLA1"]))
    return link.read_block(hub.node, registers.REAL_TIME, length, flags=wire.NO_FORWARD, tries=tries)


class Rescan:
    """Finds the nodes of the wanted boards again after a bus reset, a few nodes a cycle so that writes continue.

    Nodes are numbered without gaps, so two silent nodes in a row are the end of the bus (a single one may be waking up,
    or its reply was lost). A board that is not found in two passes is away, and the cycle continues without it; its
    return causes the next reset, which restarts the scan. As replies may be lost, or a device be opened later, one node
    is read once a second. Without the hub, the scan continues.
    """

    def __init__(self, link: Link, nodes: dict[int, int], hub: int) -> None:
        self._link = link
        self._nodes, self._hub = nodes, hub
        self.found: dict[int, int] = {}
        self.away: frozenset[int] = frozenset()
        """Boards that were not found in a finished scan."""
        self._node = self._silent = self._turns = self._probe_ns = 0
        self.active = False

    def start(self) -> None:
        """Restart with the generation the hub last showed."""
        self._link.generation = self._link.seen_generation
        self._link.counters.bus_resets += 1
        self._link.write_quadlet(wire.BROADCAST, registers.PHY_REQUEST, 0)
        self.found, self._node, self._silent, self._turns, self.active = {}, 0, 0, 0, True

    def advance(self) -> bool:
        """Read further nodes; True when the scan is finished: all boards found, or the missing ones marked as away."""
        link = self._link
        timeout_ms = link.cycle_timeout_ms if link.real_time else SCAN_TIMEOUTS_MS[-1]
        silences = 0
        while silences < RESCAN_SILENCES:
            status = link.read_quadlet(self._node, registers.STATUS, timeout_ms=timeout_ms, tries=1)
            if link.seen_generation != link.generation:  # yet another reset
                self.start()
                return False
            if status is None:
                silences += 1
                self._silent += 1
            else:
                self._silent = 0
                if registers.board_of(status) in self._nodes:
                    self.found[registers.board_of(status)] = self._node
            if len(self.found) == len(self._nodes):
                return self._end()
            self._node += 1
            if self._silent == BUS_ENDS or self._node == NODES:
                self._node, self._silent = 0, 0
                self._turns += 1
                if self._turns >= TURNS and self._hub in self.found:
                    return self._end()
        return False

    def probe(self) -> bool:
        """Once a second read one node to find a board that is away; True: a board was found."""
        link = self._link
        if not self.away or link.now_ns() - self._probe_ns < PROBE_NS:
            return False
        self._probe_ns = link.now_ns()
        free = [node for node in range(len(self._nodes)) if node not in self.found.values()]
        self._node = next((node for node in free if node > self._node), free[0])
        status = link.read_quadlet(self._node, registers.STATUS, timeout_ms=link.cycle_timeout_ms, tries=1)
        board = registers.board_of(status) if status is not None else -1
        if board in self.away:
            self.found[board] = self._node
            self._end()
        return board in self.found

    def _end(self) -> bool:
        """Use the nodes that were found; always True."""
        self.away = frozenset(self._nodes) - frozenset(self.found)
        self._nodes.update(self.found)
        self._nodes.update(dict.fromkeys(self.away, NOWHERE))
        self.active = False
        self._probe_ns = self._link.now_ns()
        return True
