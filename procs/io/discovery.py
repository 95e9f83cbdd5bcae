"""Finding the hub and the boards behind it, in the order the boards expect (and original hosts use)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from procs.io.link import Link, is_loopback
from procs.io.port import BoardInfo, PortError
from procs.lib import blocks, registers, wire

NODES: Final = 16
ADDRESS_PAUSE_MS: Final = 200  # a board that got its address announces it before it answers again
PHY_PAUSE_MS: Final = 10
FIRST_TRIES: Final = 10
TOLD_TRIES: Final = 3
SCAN_TIMEOUTS_MS: Final = (20, 40, 100)  # one a pass; later passes only while a wanted board is missing
RESCAN_SILENCES: Final = 2  # of nodes in one cycle: what a rescan may cost
OTHER_HOST_PAUSE_MS: Final = 30  # a living host writes at least this often, or its watchdogs trip


@dataclass(frozen=True, slots=True)
class Hub:
    """The board that the network cable is plugged into."""

    board: int
    firmware: int
    fpga: int
    hardware: str


def find_hub(link: Link, address: str, asked_at: str, bridge: bool) -> Hub:
    """Give the hub its address, take the bus generation from its first reply, and learn what it is."""
    loopback = is_loopback(address)
    link.aim(asked_at, connect=loopback and asked_at == address)
    own = 0 if bridge else wire.NO_FORWARD
    if not link.write_quadlet(wire.BROADCAST, registers.IP_ADDRESS, registers.ip_quadlet(address), own):
        raise _silent(link, address)
    if not loopback:
        link.pause(ADDRESS_PAUSE_MS)
    hardware = link.read_quadlet(wire.BROADCAST, registers.HARDWARE_ID, flags=wire.NO_FORWARD, tries=FIRST_TRIES)
    if hardware is None:
        raise _silent(link, address)
    link.generation = link.seen_generation
    link.write_quadlet(wire.BROADCAST, registers.PHY_REQUEST, 0, own)
    link.pause(PHY_PAUSE_MS)
    return _known_hub(link, hardware, address, bridge)


def find_told_hub(link: Link, address: str, asked_at: str, bridge: bool) -> Hub | None:
    """The hub, found by reads alone, which refresh no watchdog; None where no earlier host gave it this address."""
    link.aim(asked_at, connect=is_loopback(address) and asked_at == address)
    hardware = link.read_quadlet(wire.BROADCAST, registers.HARDWARE_ID, flags=wire.NO_FORWARD, tries=TOLD_TRIES)
    if hardware is None:
        return None
    link.generation = link.seen_generation
    hub = _known_hub(link, hardware, address, bridge)
    told = link.read_quadlet(wire.BROADCAST, registers.IP_ADDRESS, flags=wire.NO_FORWARD)
    return hub if told == registers.ip_quadlet(link.address) else None


def _known_hub(link: Link, hardware: int, address: str, bridge: bool) -> Hub:
    """What the hub is; the link is aimed at its own address from here on."""
    values = []
    for register in (registers.STATUS, registers.FIRMWARE, registers.ETHERNET):
        value = link.read_quadlet(wire.BROADCAST, register, flags=wire.NO_FORWARD)
        if value is None:
            raise PortError(f"the hub does not answer reads of register 0x{register:02X}", address, "check the cable")
        values.append(value)
    hub = Hub(registers.board_of(values[0]), values[1], registers.fpga_of(values[2]),
              registers.hardware_name(hardware))
    _check_hub(hub, address, bridge)
    # From Rev 9 on every board has the base address plus its board id.
    own_address = address if hub.firmware < 9 else _shifted(address, hub.board)
    link.aim(own_address, connect=True)
    return hub


def _check_hub(hub: Hub, address: str, bridge: bool) -> None:
    if hub.firmware not in registers.FIRMWARE_REVISIONS:
        raise PortError(f"firmware Rev {hub.firmware} on hub board {hub.board}", address, "allowed: Rev 7, 8, 9")
    if hub.fpga == 3 and hub.firmware >= 9 and not bridge:
        raise PortError(f"hub board {hub.board} (Rev {hub.firmware}, FPGA V3) would run without FireWire", address,
                        f"Ethernet-only buses are not supported: write udpfw:{address} to use it as a bridge")


def _shifted(address: str, board: int) -> str:
    head, _, last = address.rpartition(".")
    return f"{head}.{(int(last) + board) % 256}"


def _silent(link: Link, address: str) -> PortError:
    return PortError("no controller answers", f"{address}:{link.udp_port}", "check power, cable and address of the hub")


def find_boards(link: Link, hub: Hub, wanted: Sequence[int]) -> tuple[BoardInfo, ...]:
    """All boards of the bus, by board id; every wanted one must be there with hardware and firmware we know.

    Without wanted boards, everything that answers is returned unjudged.
    """
    found: dict[int, BoardInfo] = {}  # by node
    for timeout_ms in SCAN_TIMEOUTS_MS:
        for node in range(NODES):
            info = None if node in found else _identify(link, node, hub, timeout_ms)
            if info is not None:
                found[node] = info
        if found and {info.board for info in found.values()}.issuperset(wanted):
            break
    boards = tuple(sorted(found.values(), key=lambda info: info.board))
    if wanted:
        check_boards(boards, wanted, link.address)
    return boards


def _identify(link: Link, node: int, hub: Hub, timeout_ms: int) -> BoardInfo | None:
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
                     board == hub.board)


def check_boards(boards: Sequence[BoardInfo], wanted: Sequence[int], where: str) -> None:
    """Raise PortError for a board that is missing, there twice, or of the wrong kind."""
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
        if info.firmware not in registers.FIRMWARE_REVISIONS:
            raise PortError(f"firmware Rev {info.firmware}", f"{where} board {board}", "allowed: Rev 7, 8, 9")
    revisions = {by_id[board].firmware for board in wanted}
    if 7 in revisions and len(revisions) > 1:
        mix = ", ".join(f"board {board}: Rev {by_id[board].firmware}" for board in wanted)
        raise PortError(f"firmware does not match ({mix})", where, "allowed: all Rev 7, or Rev 8 and 9")


def tune_gap(link: Link, boards: Sequence[BoardInfo]) -> None:
    """Make all nodes use the smallest safe gap count; the power-up value wastes bus time on every packet."""
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


def refuse_other_host(link: Link, hub: Hub) -> None:
    """Raise PortError when somebody else samples the boards: the time since the last sample would be too short."""
    if not link.real_time:
        return
    length = 4 * blocks.read_quads(hub.firmware, *blocks.AXES_OF.get(hub.hardware, blocks.AXES_OF["QLA1"]))
    if _sample(link, length) is None:
        raise PortError("the hub does not answer real-time reads", link.where, "check its firmware")
    link.pause(OTHER_HOST_PAUSE_MS)
    data = _sample(link, length)
    since_s = (int.from_bytes(data[:4], "big") + 1) * registers.TICK_S if data else 0.0
    if data and since_s < OTHER_HOST_PAUSE_MS * 0.5e-3:
        raise PortError(f"another host uses this bus (the boards were sampled {since_s * 1e3:.1f} ms ago, not by us)",
                        link.where, "allowed: one host; stop the other")


def _sample(link: Link, length: int) -> bytes | None:
    """The real-time block of the hub, before any node number is known."""
    return link.read_block(wire.BROADCAST, registers.REAL_TIME, length, flags=wire.NO_FORWARD)


class Rescan:
    """Finds the nodes of the wanted boards again after a bus reset, a few nodes a cycle so that writes go on."""

    def __init__(self, link: Link, nodes: dict[int, int]) -> None:
        self._link = link
        self._nodes = nodes
        self._found: dict[int, int] = {}
        self._node = 0
        self.active = False

    def start(self) -> None:
        """Begin anew with the generation the hub last showed."""
        self._link.generation = self._link.seen_generation
        self._link.counters.bus_resets += 1
        self._link.write_quadlet(wire.BROADCAST, registers.PHY_REQUEST, 0)
        self._found, self._node, self.active = {}, 0, True

    def advance(self) -> bool:
        """Ask further nodes; True when every board has its node again (in the map given at construction)."""
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
            elif registers.board_of(status) in self._nodes:
                self._found[registers.board_of(status)] = self._node
            if len(self._found) == len(self._nodes):
                self._nodes.update(self._found)
                self.active = False
                return True
            self._node = (self._node + 1) % NODES
        return False
