"""Requests and replies that go astray between the boards and a host."""

from __future__ import annotations

import pytest

from tests.boards.rails import MS, START, Rails, two_buses
from tests.fpga import board_side
from trocar.procs.boards.emulation import Emulation
from trocar.procs.boards.packet_faults import KINDS, NEVER, PacketFaults
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga import wire

BOTH = range(2)


class AskingHost:
    """Asks the boards of two buses for their status and takes what comes, label by label."""

    def __init__(self, seed: int = 1) -> None:
        self.world = Emulation(two_buses(), Rails(7), START)
        self.packet_faults = PacketFaults(2, seed)
        self.now, self.label = START, 0

    def ask(self, bus: int = 0) -> list[bytes]:
        """What arrives at once."""
        self.now += MS // 10
        self.label = self.label + 1 & 63
        if not self.packet_faults.arrives(bus):
            return []
        reply = self.world.answer(bus, wire.quadlet_read(0, reg.STATUS, self.label, 1), self.now)
        assert reply is not None
        return [bytes(data) for data, _ in self.packet_faults.leave(bus, reply, "host", self.now)]

    def good(self, replies: list[bytes]) -> bool:
        """One reply, with the label of the question."""
        if len(replies) != 1:
            return False
        response = board_side.decode_response(replies[0])
        return isinstance(response, board_side.WireResponse) and response.tl == self.label


def test_nothing_happens_until_it_is_asked_for() -> None:
    host = AskingHost()
    assert not host.packet_faults.active
    assert all(host.good(host.ask(bus)) for bus in BOTH)
    assert (host.packet_faults.active, host.packet_faults.next_ns) == (False, NEVER)


@pytest.mark.parametrize("kind", KINDS)
def test_only_the_next_replies_of_that_bus_are_hit(kind: str) -> None:
    host = AskingHost()
    host.packet_faults.strike(kind, range(1), count=2, delay_ns=5 * MS)
    assert host.packet_faults.active
    assert [host.good(host.ask(bus)) for bus in (1, 0, 0, 0)] == [True, False, False, True]
    host.packet_faults.due(host.now + 5 * MS)
    assert not host.packet_faults.active


def test_a_lost_reply_was_executed() -> None:
    host = AskingHost()
    host.packet_faults.strike("lost", BOTH, count=1)
    packets = host.world.buses[0].packets
    assert host.ask() == []
    assert host.world.buses[0].packets == packets + 1


def test_a_duplicated_reply_comes_twice() -> None:
    host = AskingHost()
    host.packet_faults.strike("duplicated", BOTH, count=1)
    first, second = host.ask()
    assert first == second
    assert host.good([first])


def test_a_dropped_request_is_answered_with_eight_bytes() -> None:
    host = AskingHost()
    host.packet_faults.strike("dropped", BOTH, count=1)
    (reply,) = host.ask()
    assert len(reply) == 8
    dropped = board_side.decode_response(reply)
    assert isinstance(dropped, board_side.Dropped)
    assert dropped.trailer.flags & wire.DROPPED
    assert dropped.trailer.generation == 1


def test_a_wrong_label_is_the_next_one() -> None:
    host = AskingHost()
    for label in (8, 63):
        host.label = label - 1
        whole = host.ask()[0]
        host.label -= 1
        host.packet_faults.strike("mislabelled", BOTH, count=1)
        wrong = board_side.decode_response(host.ask()[0])
        assert isinstance(wrong, board_side.WireResponse)
        assert wrong.tl == (label + 1) % 64
        assert board_side.decode_response(whole) != wrong
        assert wrong.data == board_side.decode_response(whole).data  # type: ignore[union-attr]  # not a dropped one


def test_a_late_reply_comes_when_it_is_due() -> None:
    host = AskingHost()
    host.packet_faults.strike("late", BOTH, count=1, delay_ns=7 * MS)
    assert host.ask(1) == []
    first = host.now + 7 * MS
    assert (host.ask(0), len(host.ask(0))) == ([], 1)
    assert host.packet_faults.next_ns == first
    assert host.packet_faults.due(first - 1) == []
    ((bus, reply, sender),) = host.packet_faults.due(first)
    assert (bus, sender) == (1, "host")
    assert isinstance(board_side.decode_response(reply), board_side.WireResponse)
    assert host.packet_faults.next_ns == first + MS // 10
    assert [bus for bus, _, _ in host.packet_faults.due(first + 100 * MS)] == [0]
    assert (host.packet_faults.next_ns, host.packet_faults.active) == (NEVER, False)


def test_a_late_reply_keeps_what_it_said() -> None:
    packet_faults, buffer = PacketFaults(1), bytearray(range(32))
    packet_faults.strike("late", range(1), count=1, delay_ns=MS)
    packet_faults.leave(0, memoryview(buffer), "host", 0)
    buffer[:] = bytes(32)
    assert packet_faults.due(MS) == [(0, bytes(range(32)), "host")]


def test_several_mishaps_may_come_together() -> None:
    host = AskingHost()
    for kind in ("late", "duplicated", "mislabelled"):
        host.packet_faults.strike(kind, BOTH, count=1, delay_ns=3 * MS)
    assert host.ask() == []
    replies = [reply for _, reply, _ in host.packet_faults.due(host.now + 3 * MS)]
    assert len(replies) == 2
    assert not host.good(replies[:1])
    host.packet_faults.strike("lost", BOTH, count=1)
    host.packet_faults.strike("duplicated", BOTH, count=1)
    assert (len(host.ask()), len(host.ask())) == (0, 2)  # what is lost uses nothing else up


def _pass(packet_faults: PacketFaults, bus: int, count: int) -> tuple[list[bool], int]:
    """Whether each of so many questions is answered, and how many reached the boards."""
    answered, arrived = [], 0
    for _ in range(count):
        arrives = packet_faults.arrives(bus)
        arrived += arrives
        answered.append(arrives and bool(packet_faults.leave(bus, bytes(28), "host", 0)))
    return answered, arrived


def test_rates_hold_until_changed() -> None:
    packet_faults = PacketFaults(2)
    packet_faults.strike("lost", range(1), rate=0.25)
    assert 0.71 <= sum(_pass(packet_faults, 0, 4000)[0]) / 4000 <= 0.79
    assert all(_pass(packet_faults, 1, 100)[0])
    packet_faults.strike("lost", range(1), rate=1.0)
    assert not any(_pass(packet_faults, 0, 100)[0])
    packet_faults.strike("lost", range(1), rate=0.0)
    assert all(_pass(packet_faults, 0, 100)[0])
    assert not packet_faults.active


def test_lost_packets_are_requests_as_well_as_replies() -> None:
    packet_faults = PacketFaults(1)
    packet_faults.lose_packets(0.2, range(1))
    answered, arrived = _pass(packet_faults, 0, 4000)
    assert 0.77 <= arrived / 4000 <= 0.83
    assert 0.60 <= sum(answered) / 4000 <= 0.68


def test_chance_follows_the_seed_and_not_the_other_bus() -> None:
    def answered(seed: int, others: int) -> list[bool]:
        packet_faults = PacketFaults(2, seed)
        packet_faults.lose_packets(0.3, BOTH)
        got = []
        for _ in range(64):
            _pass(packet_faults, 1, others)
            got += _pass(packet_faults, 0, 1)[0]
        return got

    assert answered(1, 0) == answered(1, 2) != answered(2, 0)


def test_everything_can_be_ended_at_once() -> None:
    host = AskingHost()
    for kind in KINDS:
        host.packet_faults.strike(kind, BOTH, count=5)
        host.packet_faults.strike(kind, BOTH, rate=0.5)
    host.packet_faults.lose_packets(0.5, BOTH)
    host.packet_faults.end()
    assert not host.packet_faults.active
    assert all(host.good(host.ask()) for _ in range(20))
