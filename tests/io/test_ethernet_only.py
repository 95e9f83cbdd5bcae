"""Buses without FireWire: every board has an address of its own, and the reply to a query comes unasked."""

from __future__ import annotations

import pytest

from tests.cases import cases
from tests.fpga import board_side
from tests.io.boards_harness import Direct
from tests.io.test_udp_discovery import recorded_requests, without_address
from trocar.procs.boards.controllers.bus import EmulatedBus
from trocar.procs.document.system import Controller
from trocar.procs.fpga import blocks, registers, wire
from trocar.procs.io.bus.bus_port import BusPort, PortOptions
from trocar.procs.io.bus.protocols import BROADCAST_QUERY, SEQUENTIAL, SEQUENTIAL_BROADCAST
from trocar.procs.io.bus.transport import PortError
from trocar.procs.io.bus.udp import address_of


def late(board: int, hardware: str = "QLA1") -> Controller:
    return Controller(board, hardware, 9, "V3")


class EthernetBoards:
    """Controllers that answer at once, and what they heard."""

    def __init__(self, *rows: Controller) -> None:
        self.bus = EmulatedBus(rows, network="ethernet")
        self.ids = sorted(row.board_id for row in rows)
        self.heard: list[tuple[int, bytes]] = []
        self.change = lambda request, reply: reply
        self.now_ns = 0

    def clock(self) -> int:
        self.now_ns += 1000
        return self.now_ns

    def answer(self, _bus: int, data: bytes, now_ns: int, to: int) -> bytes | None:
        self.heard.append((to, data))
        reply = self.bus.answer(data, now_ns * 49 // 1000, to)
        return None if reply is None else self.change(data, bytes(reply))

    def port(self, protocol: str = BROADCAST_QUERY) -> BusPort:
        options = PortOptions(protocol, real_time=False, exclusive=False)
        return BusPort(Direct(self, 0, self.clock), self.ids, self.clock, options)


@pytest.mark.parametrize(
    ("recording", "protocol"),
    [("d_r9_p0", SEQUENTIAL), ("d_r9_p1", SEQUENTIAL_BROADCAST), ("d_r9_p2", BROADCAST_QUERY)],
)
def test_we_send_what_the_original_host_sent(data, recording, protocol):
    recorded = recorded_requests(data("golden/wire") / f"{recording}.jsonl")
    boards = EthernetBoards(late(0), late(1), late(5))
    boards.bus.generation = 3
    commands = [board_side.decode_request(d) for d in recorded if d[5] >> 4 == wire.BLOCK_WRITE]
    per_cycle = 3 if protocol == SEQUENTIAL else 1
    with boards.port(protocol) as port:
        port._link.tl = port._link.sequence = 0  # the original host begins there, we do anywhere
        port.discover()
        for at in range(0, len(commands), per_cycle):
            assert port.read_all()
            groups = board_side.decode_write(b"".join(request.data for request in commands[at : at + per_cycle]), 9)
            port.out[...] = [(*group.dac, group.control) for group in groups]
            assert port.write_all()
    ours = [without_address(datagram) for _, datagram in boards.heard]
    assert ours == [without_address(datagram) for datagram in recorded[: len(ours)]]
    assert len(recorded) - len(ours) <= 2 and len(commands) > 3


MIXED = (late(4, "DQLA"), late(1), late(6, "dRA1"), late(2))


def test_blocks_are_taken_in_the_order_in_which_they_come():
    boards = EthernetBoards(*MIXED)
    with boards.port() as port:
        port.discover()
        before = len(boards.heard)
        for _ in range(3):
            assert port.read_all()
            status = port.blocks[:, blocks.STATUS]
            assert [registers.board_of(int(word)) for word in status] == [1, 2, 4, 6]
            assert [registers.axes_of(int(word)) for word in status] == [4, 4, 8, 10]
        assert len(boards.heard) - before == 3  # a cycle is one datagram there, one back, one write
        boards.change = shuffled([4, 1, 2, 6], [6, 2, 1, 4])
        assert port.read_all() and port.read_all()
        status = port.blocks[:, blocks.STATUS]
        assert [registers.board_of(int(word)) for word in status] == [1, 2, 4, 6]


def shuffled(old, new):
    """The blocks of a reply in another order of boards."""

    def change(request, reply):
        if len(reply) < 200:
            return reply
        parts, at = {}, 20
        for board in old:
            parts[board] = reply[at : at + 4 * reply[at]]
            at += 4 * reply[at]
        return reply[:20] + b"".join(parts[board] for board in new) + reply[at:]

    return change


@cases(
    ("at", "bits"), [(20, 1), (21, 1), (22, 0x80), (28, 0x01), (0, 0), (2, 4), (5, 1), (13, 4)])  # fmt: skip
def test_wrong_unasked_replies_are_bad_reads(at, bits):
    boards = EthernetBoards(late(3), late(5))

    def spoilt(request, reply):
        changed = bytearray(reply)
        changed[at] ^= bits
        return bytes(changed) if at else b""

    with boards.port() as port:
        port.discover()
        assert port.read_all()
        kept = port.blocks.copy()
        boards.change = spoilt
        assert not port.read_all()
        assert (port.blocks == kept).all() and port.bad.any()
        boards.change = lambda request, reply: reply
        assert port.read_all()


def test_a_reply_that_did_not_come_is_asked_for():
    boards = EthernetBoards(late(3), late(5))
    with boards.port() as port:
        port.discover()
        port._link.transport.lose = 1
        kept = port.blocks.copy()
        assert port.read_all()
        assert (port.blocks != kept).any() and port.counters.timeouts == 1
        to, request = boards.heard[-1]
        assert (to, board_side.decode_request(request).address) == (3, registers.HUB)


def test_boards_that_need_firewire_are_refused():
    boards = EthernetBoards(late(3), late(5))
    boards.change = lambda request, reply: (
        reply[:12] + (8).to_bytes(4, "big") + reply[16:]
        if board_side.decode_request(request).address == registers.FIRMWARE and request[3] & 0x3F == 5 else reply)
    with boards.port() as port, pytest.raises(PortError, match="board 5: firmware Rev 8 on FPGA V3 needs FireWire"):
        port.discover()


def test_boards_are_at_the_address_of_the_bus_plus_their_id():
    assert address_of("169.254.0.100", 5) == "169.254.0.105"
    assert address_of("10.0.0.250", 10) == "10.0.0.4", "the last octet alone is increased"
