"""Replies that come late, twice, in another order or not at all, on a line with its own time.

No reply is ever taken for that to another request, and 100 ms after the boards answer again every read is good.
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import pytest
from hypothesis import HealthCheck, Phase, given
from hypothesis import strategies as st

from tests.examples import examples
from tests.fpga import board_side
from trocar.procs.boards.controllers.bus import GROUP, EmulatedBus
from trocar.procs.document.system import Controller
from trocar.procs.fpga import blocks, registers, wire
from trocar.procs.io.bus import discovery
from trocar.procs.io.bus.bus_port import BusPort, PortOptions
from trocar.procs.io.bus.protocols import BROADCAST_QUERY, SEQUENTIAL, SEQUENTIAL_BROADCAST

PERIOD_NS = 666_667
WAY_NS, WORK_NS = 20_000, 30_000  # of a datagram, either way; of the boards, for each
MS = 1_000_000
HEALED_NS = 100 * MS
IDS = (2, 3, 5)
ALWAYS = 1 << 62
HEADER, HUB_BLOCK = 20, 4 * 33


class WorkingClock:
    def __init__(self) -> None:
        self.ns = 1_000_000_000

    def __call__(self) -> int:
        self.ns += 500  # who asks has worked meanwhile
        return self.ns


@dataclass
class Disorder:
    """What happens to replies until `end_ns`, and when the boards stand still."""

    lost: float = 0.0
    late: float = 0.0
    doubled: float = 0.0
    latest_ns: int = 0
    stops: tuple[tuple[int, int], ...] = ()  # from, to
    end_ns: int = 0


class DisorderedLine:
    """A transport to boards that answer everything in the order it came, also what came while they stood still.

    `has_ports`: replies reach whoever asked, and nobody after it has forgotten them. Every sample carries, as its time
    stamp, the number of the request that it answers; that of the second board of a hub the number of the query.
    """

    where, on_firewire, gives_address, pause_ms, stranger = "a line", False, registers.ip_quadlet("127.0.0.1"), 0, ""
    most_read = most_write = wire.MAX_DATA

    def __init__(self, network: str, clock: WorkingClock, ids: tuple[int, ...], *, has_ports: bool, seed: int) -> None:
        late = network == "ethernet"
        self.bus = EmulatedBus(tuple(Controller(board, firmware=9 if late else 8, fpga="V3" if late else "V2")
                                     for board in ids), network=network)
        self.clock, self.has_ports, self.dice = clock, has_ports, random.Random(seed)
        self.problem = Disorder()
        self.newest: dict[object, int] = {}  # number of the newest request, by node; "query": of those
        self.labels: list[tuple[int, int]] = []  # of what was answered, and when that was asked
        self.writes = self.reads = self.free_ns = 0
        self._by_board, self._port, self._number, self._query = False, 0, 0, 0
        self._coming: list[tuple[int, int, int, bytes]] = []  # when, order, port, reply

    def open(self) -> None: ...

    def close(self) -> None: ...

    def forget(self) -> bool:
        self._port += 1
        return self.has_ports

    def ask_everybody(self) -> int:
        return 0

    def aim(self, board: int, firmware: int, *, by_board: bool) -> int:
        self._by_board = by_board
        return 0

    def send(self, datagram: wire.Buffer) -> None:
        now, data, problem = self.clock(), bytes(datagram), self.problem
        self._number += 1
        request = board_side.decode_request(data)
        is_read, is_query = request.tcode == wire.BLOCK_READ, request.address == registers.QUERY
        self.reads, self.writes = self.reads + is_read, self.writes + (request.tcode == wire.BLOCK_WRITE)
        if is_read:
            self.newest[request.node] = self.newest["read"] = self._number
        if is_query:
            self.newest["query"] = self._query = self._number
        begin = max(now + WAY_NS, self.free_ns)
        for stopped, resumed in problem.stops:
            begin = resumed if stopped <= begin < resumed else begin
        self.free_ns = begin + WORK_NS
        if begin >= ALWAYS and not is_read:
            return  # it never reaches a board, and no reply is expected
        to = request.node if self._by_board and request.node != wire.BROADCAST else GROUP
        reply = self.bus.answer(data, self.free_ns * 49 // 1000, to)
        if reply is not None:
            self.labels.append((now, request.tl))
            self._leave(self._stamped(bytes(reply), request.address == registers.REAL_TIME), self.free_ns + WAY_NS)

    def _stamped(self, reply: bytes, is_sample: bool) -> bytes:
        if len(reply) <= wire.QUADLET_RESPONSE_BYTES:
            return reply
        stamps = {HEADER if is_sample else HEADER + 4: self._number}
        if not is_sample:
            stamps[HEADER + 4 + HUB_BLOCK] = self._query
        changed = bytearray(reply)
        for at, number in stamps.items():
            changed[at : at + 4] = number.to_bytes(4, "big")
        return bytes(changed)

    def _leave(self, reply: bytes, due_ns: int) -> None:
        problem, chance = self.problem, self.dice.random
        if self.clock.ns < problem.end_ns:
            if chance() < problem.lost:
                return
            if chance() < problem.late:
                due_ns += round(chance() * problem.latest_ns)
            if chance() < problem.doubled:
                self._put(reply, due_ns + round(chance() * 3 * MS))
        self._put(reply, due_ns)

    @property
    def is_coming(self) -> bool:
        """Whether replies are on their way."""
        return bool(self._coming)

    def _put(self, reply: bytes, due_ns: int) -> None:
        heapq.heappush(self._coming, (due_ns, self._number, self._port, reply))

    def poll(self, timeout_ms: int) -> bool:
        coming, until = self._coming, self.clock() + timeout_ms * MS
        while coming and coming[0][0] <= until and self.has_ports and coming[0][2] != self._port:
            heapq.heappop(coming)
        if coming and coming[0][0] <= until:
            self.clock.ns = max(self.clock.ns, coming[0][0])
            return True
        self.clock.ns = until
        return False

    def recv_into(self, buffer: memoryview) -> int:
        reply = heapq.heappop(self._coming)[3]
        buffer[: len(reply)] = reply
        return len(reply)


class LateHost:
    """A host that reads and writes once a period, and looks at whose replies it took."""

    def __init__(self, kind: str, ids: tuple[int, ...] = IDS, *, has_ports: bool, seed: int = 1) -> None:
        protocol, _, network = kind.partition(" on ")
        self.is_sequential, self.network, self.clock = protocol != BROADCAST_QUERY, network or "bridge", WorkingClock()
        self.line = DisorderedLine(self.network, self.clock, ids, has_ports=has_ports, seed=seed)
        self.port = BusPort(self.line, ids, self.clock, PortOptions(protocol, exclusive=False))
        self.port.discover()
        self.nodes = [self.port.info(board).node for board in ids]

    def cycle(self) -> bool:
        begin, writes = self.clock.ns, self.line.writes
        good = self.port.read_all()
        if good:
            self.check()
        assert self.port.write_all() and self.line.writes > writes, "writes feed the watchdogs"
        self.clock.ns = max(self.clock.ns, begin + PERIOD_NS)
        return good

    def check(self) -> None:
        """What was taken for fresh are replies to the newest requests."""
        stamps, newest = self.port.blocks[:, blocks.TIMESTAMP].tolist(), self.line.newest
        if self.is_sequential:
            assert stamps == [newest[node] for node in self.nodes]
            return
        assert stamps[1] == newest["query"]
        assert stamps[0] == newest.get("read") or (self.network == "ethernet" and stamps[0] == newest["query"])

    def run(self, until_ns: int) -> list[bool]:
        """Which cycles were good."""
        good = []
        while self.clock.ns < until_ns:
            good.append(self.cycle())
        return good

    def suffer(self, problem: Disorder) -> None:
        """Go through it; soon afterwards all is well."""
        self.line.problem = problem
        self.run(problem.end_ns)
        self.run(self.line.free_ns)  # boards that stood still have answered all by then
        self.run(self.clock.ns + HEALED_NS)
        assert all(self.run(self.clock.ns + 50 * MS))


KINDS = (BROADCAST_QUERY, f"{BROADCAST_QUERY} on ethernet", SEQUENTIAL, SEQUENTIAL_BROADCAST)


@pytest.fixture(autouse=True)
def quick_discovery(monkeypatch):
    """The one pause in it that is on the wall clock."""
    monkeypatch.setattr(discovery, "PHY_PAUSE_MS", 0)


def problems(draw: Callable[[st.SearchStrategy[Any]], Any], begin_ns: int, latest_ms: tuple[int, ...]) -> Disorder:
    """Any, from now on."""
    stops = []
    for after, long in draw(st.lists(st.tuples(st.integers(1, 100 * MS), st.integers(MS, 250 * MS)), max_size=2)):
        stops.append((begin_ns + after, begin_ns + after + long))
        begin_ns = stops[-1][1]
    lost, late, doubled = (draw(st.sampled_from((0.0, 0.02, 0.3, 1.0))) for _ in range(3))
    return Disorder(lost, late, doubled, draw(st.sampled_from(latest_ms)) * MS, tuple(stops), begin_ns + 100 * MS)


@pytest.mark.parametrize("has_ports", [True, False], ids=["ports", "labels alone"])
@pytest.mark.parametrize("kind", KINDS)
@examples(3, phases=(Phase.explicit, Phase.generate), suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
@pytest.mark.slow
def test_replies_in_any_disorder_are_taken_for_what_they_are(kind, has_ports, data) -> None:
    """Where labels are all there is, boards that run answer soon; but they may stand still for long."""
    host = LateHost(kind, has_ports=has_ports, seed=data.draw(st.integers(0, 1 << 30)))
    host.suffer(problems(data.draw, host.clock.ns, (3, 50, 1000) if has_ports else (5,)))


@pytest.mark.parametrize("kind", KINDS)
def test_late_replies_to_earlier_sockets_are_nobodys_trouble(kind) -> None:
    host = LateHost(kind, has_ports=True)
    host.suffer(Disorder(late=0.5, latest_ns=2000 * MS, end_ns=host.clock.ns + 50 * MS))
    assert host.line.is_coming, "late replies are still on their way"


@pytest.mark.parametrize("kind", [SEQUENTIAL, SEQUENTIAL_BROADCAST])
def test_a_queue_that_is_behind_by_all_labels_is_noticed(kind) -> None:
    """The board stands still until a read waits that has the label of the first that it will answer."""

    def stopped(until_ns: int) -> LateHost:
        host = LateHost(kind, (2,), has_ports=False)
        host.port._link.tl = 0
        host.run(host.clock.ns + 5 * MS)
        host.line.labels.clear()
        host.line.problem = Disorder(stops=((host.clock.ns, until_ns),), end_ns=until_ns)
        return host

    host = stopped(ALWAYS)
    host.run(host.clock.ns + 2000 * MS)
    (_, first), *others = host.line.labels
    alike = [when for when, label in others if label == first]
    assert alike
    for when in alike[:2]:
        host = stopped(when + MS)
        host.suffer(host.line.problem)


@pytest.mark.parametrize("has_ports", [True, False], ids=["ports", "labels alone"])
@pytest.mark.parametrize("kind", KINDS)
def test_the_label_of_a_missing_reply_rests_where_that_may_still_come(kind, has_ports) -> None:
    host = LateHost(kind, has_ports=has_ports)
    host.run(host.clock.ns + 5 * MS)
    host.line.problem = Disorder(lost=1.0, end_ns=ALWAYS)
    assert not host.cycle()
    host.line.problem = Disorder()
    _, label = host.line.labels[-1]
    host.line.labels.clear()
    assert all(host.run(host.clock.ns + 100 * MS))
    assert (label in {label for _, label in host.line.labels}) == has_ports


@pytest.mark.parametrize("has_ports", [True, False], ids=["ports", "labels alone"])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.slow
def test_boards_that_are_away_are_asked_seldom(kind, has_ports) -> None:
    host = LateHost(kind, has_ports=has_ports)
    host.line.problem = Disorder(stops=((0, ALWAYS),), end_ns=ALWAYS)
    host.run(host.clock.ns + 500 * MS)
    reads, writes = host.line.reads, host.line.writes
    host.run(host.clock.ns + 1000 * MS)
    assert host.line.reads - reads <= 110 and host.line.writes - writes > 1000
