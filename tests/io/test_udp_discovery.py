from __future__ import annotations

import json
import time

import pytest

from tests.fpga import board_side
from tests.io.stub_bus import StubBoard, StubBus, bus_of, udp_port_to
from trocar.procs.fpga import registers, wire
from trocar.procs.io.bus import discovery
from trocar.procs.io.bus.protocols import BROADCAST_QUERY, SEQUENTIAL, SEQUENTIAL_BROADCAST
from trocar.procs.io.bus.transport import PortError
from trocar.procs.io.bus.udp import discovery_address
from trocar.procs.io.start import POWER_OFF

DQLA, BCFG = registers.DQLA, 0x42434647


def port_to(bus, boards, **options):
    options.setdefault("exclusive", False)
    options.setdefault("deadline_ms", 100)  # of a busy machine; the rules are the same
    kind = options.pop("kind", "udp")
    return udp_port_to(f"{kind}:{bus.address}", boards, time.monotonic_ns, udp_port=bus.port, **options)


@pytest.fixture
def two_nodes(monkeypatch):
    """Only nodes that are there are asked, once, so that a late reply can be waited for."""
    monkeypatch.setattr(discovery, "NODES", 2)
    monkeypatch.setattr(discovery, "SCAN_TIMEOUTS_MS", (5000,))


def test_broadcast_discovery_finds_the_hub():
    everybody = "127.255.255.255"
    with bus_of(2, address="127.0.0.1", bind="0.0.0.0") as bus, port_to(bus, (0, 1), asked_at=everybody) as port:
        assert len(port.discover()) == 2
        assert port.read_quadlet(1, registers.FIRMWARE) == 8


@pytest.mark.slow
@pytest.mark.parametrize(
    ("boards", "wanted", "words"),
    [
        ([StubBoard(0, 0), StubBoard(1, 1)], (0, 1, 5, 7), ("missing: board 5, 7", "0 (node 0), 1 (node 1)")),
        ([StubBoard(0, 0), StubBoard(3, 1, hardware=BCFG)], (0, 3), ("board 3", "hardware BCFG", "allowed: QLA1")),
        ([StubBoard(0, 0), StubBoard(0, 1)], (0,), ("two boards have id 0", "nodes 0 and 1")),
        ([StubBoard(0, 0, firmware=6)], (0,), ("firmware Rev 6", "allowed: Rev 7, 8, 9")),
        ([StubBoard(0, 0), StubBoard(1, 1, firmware=4)], (0, 1), ("board 1", "firmware Rev 4", "allowed: Rev 7, 8, 9")),
        ([StubBoard(0, 0), StubBoard(1, 1, firmware=7)], (0, 1), ("board 1: Rev 7", "all Rev 7, or all later ones")),
    ],
)  # fmt: skip
def test_wrong_buses_are_refused_by_name(two_nodes, boards, wanted, words):
    with StubBus(boards) as bus, port_to(bus, wanted) as port:
        with pytest.raises(PortError) as caught:
            port.discover()
        for word in (*words, bus.address):
            assert word in str(caught.value)


def test_an_address_without_controller_is_refused():
    with bus_of(1) as bus:
        pass
    with port_to(bus, (0,)) as port, pytest.raises(PortError, match="no controller answers"):
        port.discover()


def test_a_second_host_is_noticed():
    with bus_of(2) as bus, port_to(bus, (0, 1), exclusive=True) as port:
        port.discover()
        bus.boards[0].other_host_ns = 1_000_000
        with pytest.raises(PortError, match="another host uses this bus"):
            port.discover()


def test_a_board_that_was_held_up_is_not_taken_for_a_second_host(monkeypatch):
    with bus_of(2) as bus, port_to(bus, (0, 1), exclusive=True) as port:
        hub = bus.boards[0]
        sample, ages_ns = hub.sample, iter((1 << 62, 0, 3_600_000))  # two looks come right behind a try of ours

        def held_up(serial):
            hub.other_host_ns = next(ages_ns, 1 << 62)
            return sample(serial)

        monkeypatch.setattr(hub, "sample", held_up)
        assert [info.board for info in port.discover()] == [0, 1]
        assert next(ages_ns, None) is None


@pytest.mark.parametrize(("boards", "protocol"), [((1, 1), BROADCAST_QUERY), ((16,), SEQUENTIAL), ((0,), "fastest")])
def test_impossible_requests_are_refused(boards, protocol):
    with pytest.raises(PortError, match="allowed"):
        udp_port_to("udp:127.0.0.1", boards, time.monotonic_ns, protocol)


def test_discovery_asks_everybody_outside_loopback():
    assert discovery_address("127.3.2.16") == "127.3.2.16"
    assert discovery_address("169.254.0.100") == "169.254.255.255"
    assert discovery_address("10.1.2.3") == "10.255.255.255"
    assert discovery_address("192.168.1.5") == "192.168.1.255"


def recorded_requests(path):
    rows = [json.loads(line) for line in path.read_text().splitlines()]
    return [bytes.fromhex(row["hex"]) for row in rows if row.get("dir") == "host->board"]


def without_address(datagram):
    """The one quadlet that differs: where the recorded hub was."""
    request = board_side.decode_request(datagram)
    return datagram[:14] if request.address == registers.IP_ADDRESS else datagram


@pytest.mark.parametrize(
    ("recording", "protocol", "ids", "firmware"),
    [
        ("d_r7_p0", SEQUENTIAL, (0, 1), 7),
        ("d_r7_p1", SEQUENTIAL_BROADCAST, (0, 1), 7),
        ("d_r7_p2", BROADCAST_QUERY, (0, 1), 7),
        ("d_r8_p0", SEQUENTIAL, (0, 1), 8),
        ("d_r8_p1", SEQUENTIAL_BROADCAST, (0, 1), 8),
        ("d_r8_p2", BROADCAST_QUERY, (0, 1), 8),
        ("d_r9b_p2", BROADCAST_QUERY, (2, 5), 9),
    ],
)
def test_we_send_what_the_original_host_sent(data, recording, protocol, ids, firmware):
    recorded = recorded_requests(data("golden/wire") / f"{recording}.jsonl")
    commands = [board_side.decode_request(d) for d in recorded if d[5] >> 4 == wire.BLOCK_WRITE]
    assert commands and not is_cyclic(recorded[0])
    for _ in range(5):  # on a busy machine a board may be late, and is asked again
        ours = [without_address(d) for d in requests_to(ids, firmware, protocol, commands)]
        if ours == [without_address(d) for d in recorded[: len(ours)]]:
            break
    assert ours == [without_address(d) for d in recorded[: len(ours)]]
    assert len(recorded) - len(ours) <= 2


def requests_to(ids, firmware, protocol, commands):
    """What we send to find boards of these numbers, and to carry out these commands."""
    bridge = firmware == 9
    ethernet = 0x40B1A0A0 if bridge else 0xA01C0000
    boards = [StubBoard(board, node, firmware=firmware, ethernet=ethernet) for node, board in enumerate(ids)]
    hub = len(ids) - 1 if bridge else 0
    per_cycle = len(ids) if protocol == SEQUENTIAL else 1
    with StubBus(boards, hub=hub) as bus:
        with port_to(bus, ids, protocol=protocol, kind="udpfw" if bridge else "udp") as port:
            port._link.tl = port._link.sequence = 0  # the original host begins there, we do anywhere
            port.discover()
            for first in range(0, len(commands), per_cycle):
                port.read_all()
                cycle = commands[first : first + per_cycle]
                groups = board_side.decode_write(b"".join(request.data for request in cycle), firmware)
                port.out[...] = [(*group.dac, group.control) for group in groups]
                assert port.write_all()
            port.read_quadlet(ids[0], 0)  # answered: so everything before has arrived
        return bus.heard[:-1]


def is_cyclic(datagram):
    request = board_side.decode_request(datagram)
    return request.tcode in (wire.BLOCK_READ, wire.BLOCK_WRITE) or request.address == registers.QUERY


@pytest.mark.slow
def test_power_is_switched_off_even_when_the_bus_is_then_refused():
    boards = [StubBoard(0, 0), StubBoard(1, 1)]
    with (
        StubBus(boards) as bus,
        port_to(bus, (0, 1, 5), exclusive=True, first_control=POWER_OFF) as port,
        pytest.raises(PortError, match="missing: board 5"),
    ):
        port.discover()
    assert all((registers.STATUS, POWER_OFF) in board.writes for board in boards)


def test_a_bus_of_another_host_is_left_as_it_is():
    boards = [StubBoard(0, 0, other_host_ns=500_000)]
    with (
        StubBus(boards) as bus,
        port_to(bus, (0,), exclusive=True, first_control=POWER_OFF) as port,
        pytest.raises(PortError, match="another host"),
    ):
        port.discover()
    assert (registers.STATUS, POWER_OFF) not in boards[0].writes
