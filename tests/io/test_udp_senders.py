"""Who is heard: the boards, and only in reply to what was asked of this very socket."""

from __future__ import annotations

import contextlib
import select
import socket
from collections.abc import Iterator

import pytest

from tests.fpga import board_side
from tests.io.emulated_ports import block_address
from tests.io.harness import IoHarness
from trocar.procs.fpga import wire
from trocar.procs.io.bus.udp import PORTS, UdpTransport, address_of

ASKING = wire.quadlet_read(wire.BROADCAST, 4, 1, 0)


def reply_of(node: int) -> bytes:
    return board_side.quadlet_response(node, 1, 7, board_side.Trailer())


def bound(address: str, port: int = 0) -> socket.socket:
    made = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    made.bind((address, port))
    made.settimeout(5.0)
    return made


class SenderBoards:
    """A socket at every address of a bus, and two that are none of them."""

    def __init__(self) -> None:
        self.address = block_address()
        first = bound(self.address)
        self.udp_port = first.getsockname()[1]
        self.sockets = [first, *(bound(address_of(self.address, node), self.udp_port) for node in range(1, wire.NODES))]
        self.elsewhere, self.other_port = bound("127.0.0.1"), bound(self.address)

    def close(self) -> None:
        for each in (*self.sockets, self.elsewhere, self.other_port):
            each.close()


@pytest.fixture
def boards() -> Iterator[SenderBoards]:
    with contextlib.closing(SenderBoards()) as made:
        yield made


@pytest.fixture
def transport(boards: SenderBoards) -> Iterator[UdpTransport]:
    made = UdpTransport(boards.address, udp_port=boards.udp_port)
    made.open()
    with contextlib.closing(made):
        yield made


def own_address(transport: UdpTransport) -> tuple[str, int]:
    assert transport._socket is not None
    return transport._socket.getsockname()


def heard(transport: UdpTransport) -> list[int]:
    """Sizes of all that has come."""
    sizes, buffer = [], memoryview(bytearray(4096))
    while transport.poll(20):
        sizes.append(transport.recv_into(buffer))
    return sizes


@pytest.mark.parametrize("by_board", [None, True], ids=["discovery", "by board"])
def test_only_addresses_of_the_bus_and_the_port_of_controllers_are_heard(boards, transport, by_board) -> None:
    if by_board:
        transport.aim(3, 9, by_board=True)
    to, reply = own_address(transport), reply_of(3)
    boards.sockets[3].sendto(reply, to)
    assert heard(transport) == [len(reply)] and not transport.stranger
    for sock in (boards.elsewhere, boards.other_port):
        sock.sendto(reply, to)
        assert heard(transport) == [0]
        assert transport.stranger == "{}:{}".format(*sock.getsockname())


def test_a_board_speaks_for_itself_only(boards, transport) -> None:
    transport.aim(3, 9, by_board=True)
    boards.sockets[4].sendto(reply_of(3), own_address(transport))
    assert heard(transport) == [0] and transport.stranger.startswith(f"{address_of(boards.address, 4)}:")
    boards.sockets[4].sendto(board_side.encode_trailer(board_side.Trailer(wire.DROPPED)), own_address(transport))
    assert heard(transport) == [wire.TRAILER_BYTES], "a dropped request has no sender but that of the datagram"


def test_behind_a_hub_nobody_else_is_even_received(boards, transport) -> None:
    transport.aim(0, 8, by_board=False)
    for sock in (boards.elsewhere, boards.other_port, boards.sockets[1]):
        sock.sendto(reply_of(0), own_address(transport))
    assert heard(transport) == []
    boards.sockets[0].sendto(reply_of(0), own_address(transport))
    assert heard(transport) == [len(reply_of(0))]


@pytest.mark.parametrize("by_board", [True, False])
def test_replies_to_what_was_asked_before_reach_nobody(boards, transport, by_board) -> None:
    transport.aim(0, 9 if by_board else 8, by_board=by_board)
    request = wire.quadlet_read(0, 4, 1, 0)
    transport.send(request)
    asked, before = boards.sockets[0].recvfrom(4096)
    assert asked == request
    boards.sockets[0].sendto(reply_of(0), before)
    assert transport.poll(2000), "it has come"
    assert transport.forget()
    boards.sockets[0].sendto(reply_of(0), before)  # and another one, late
    assert heard(transport) == []
    transport.send(request)
    _, now = boards.sockets[0].recvfrom(4096)
    assert now != before
    boards.sockets[0].sendto(reply_of(0), now)
    assert heard(transport) == [len(reply_of(0))]


def test_ports_come_round_only_after_all_others_and_begin_anywhere(boards, transport) -> None:
    ports = [own_address(transport)[1]]
    for _ in range(500):
        assert transport.forget()
        ports.append(own_address(transport)[1])
    assert len(set(ports)) == len(ports)
    assert transport._stride % 2, f"so it comes to all {PORTS}"
    begun = {UdpTransport(boards.address)._port for _ in range(20)}
    assert len(begun) > 10


def test_a_socket_that_cannot_be_replaced_is_kept(boards, transport, monkeypatch) -> None:
    transport.aim(0, 8, by_board=False)

    def none_left(*_: object) -> socket.socket:
        raise OSError(24, "Too many open files")

    monkeypatch.setattr(socket, "socket", none_left)
    assert not transport.forget()
    transport.send(ASKING)
    assert select.select([boards.sockets[0]], [], [], 5.0)[0]


def test_a_stranger_is_reported_once() -> None:
    harness = IoHarness()

    def sends(address: str) -> list[str]:
        harness.core.reports.events.clear()
        harness.port.stranger = address
        harness.port.counters.stray += 1
        harness.run(2)
        return [event.text for event in harness.core.reports.events if event.code == "foreign-datagrams"]

    (text,) = sends("127.0.0.1:4444")
    assert text.startswith("IO1: datagrams from 127.0.0.1:4444 are ignored") and harness.record.valid
    assert sends("127.0.0.1:4444") == sends("127.0.0.1:4445") == []
    harness.clock.ns += 120_000_000_000
    assert len(sends("127.0.0.1:4445")) == 1
