"""What every port does, whatever carries the bytes: one test over all of them."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from tests.io.emulated_ports import ROOT, WITHOUT, PortBench, in_namespace, nothing_wrong, run_in_namespace, times
from tests.io.fake_firewire import FakeFirewire
from tests.io.stub_bus import eventually_reads
from trocar.procs.fpga import blocks, registers, wire
from trocar.procs.io.bus import discovery
from trocar.procs.io.bus.bus_port import ALL_BOARDS
from trocar.procs.io.bus.protocols import BROADCAST_QUERY, PROTOCOLS
from trocar.procs.io.bus.transport import PortError

pytestmark = pytest.mark.slow

ON_CABLE = ("eth", "ethfw", f"eth {WITHOUT}")
KINDS = ON_CABLE if in_namespace() else ("udp", "udpfw", f"udp {WITHOUT}", "fw", "fw, this computer first")


@pytest.mark.skipif(in_namespace(), reason="this is the namespace")
def test_all_of_this_holds_over_raw_ethernet_on_a_virtual_cable():
    done = run_in_namespace(sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", __file__,
                            str(ROOT / "tests/io/test_raw_ethernet.py"), str(ROOT / "tests/io/test_distant_boards.py"))
    assert done.returncode == 0, done.stdout[-6000:] + done.stderr[-2000:]


@pytest.fixture(autouse=True)
def quick_scan(monkeypatch):
    """Thirteen silent nodes at 20 ms each would be most of the time here."""
    monkeypatch.setattr(discovery, "SCAN_TIMEOUTS_MS", (4, 40))


@pytest.fixture
def patient_scan(monkeypatch, quick_scan):
    """Where no board is wanted, there is no second pass for one that was late. The last controller is node 4."""
    monkeypatch.setattr(discovery, "SCAN_TIMEOUTS_MS", (200,))
    monkeypatch.setattr(discovery, "NODES", 5)


@pytest.fixture(params=KINDS)
def bench(request):
    kind = request.param
    made = FakeFirewire(first=kind != "fw") if kind.startswith("fw") else PortBench(kind)
    with made:
        yield made


@pytest.fixture(params=PROTOCOLS)
def protocol(request):
    return request.param


def boards_in(port):
    return (port.blocks[:, blocks.STATUS] >> registers.STATUS_BOARD_SHIFT & 0xF).tolist()


def lost(request, replies):
    return []


def test_boards_are_found_and_named(bench):
    with bench.port() as port:
        found = port.discover()
    assert [(info.board, info.hardware) for info in found] == [(board, "QLA1") for board in bench.ids]
    assert sum(info.is_hub for info in found) == (0 if bench.kind == "fw" else 1)
    nodes = [info.node for info in found]
    assert len(set(nodes)) == len(nodes)


def test_everything_is_listed_where_no_board_is_wanted(bench, patient_scan):
    with bench.port(boards=()) as port:
        assert [info.board for info in port.discover()] == list(bench.ids)
        with pytest.raises(PortError, match="not discovered"):
            port.read_all()


def test_boards_are_found_by_reads_alone_where_a_host_was_before(bench, patient_scan):
    with bench.port() as port:
        port.discover()
        port.read_quadlet(bench.ids[0], 0)  # answered: so everything before has arrived
    del bench.requests[:]
    with bench.port(boards=(), quiet=True) as port:
        assert [info.board for info in port.discover()] == list(bench.ids)
    assert bench.requests
    assert all(r[5] >> 4 in (wire.QUADLET_READ, wire.BLOCK_READ) for r in bench.requests)


def test_a_missing_board_is_told(bench):
    with bench.port(boards=(*bench.ids, 9)) as port, pytest.raises(PortError, match="missing: board 9"):
        port.discover()


def test_registers_and_blocks_of_one_board(bench):
    first, second = bench.ids[:2]
    with bench.port() as port:
        port.discover()
        port.write_quadlet(second, registers.WATCHDOG, 0x1234)
        assert [port.read_quadlet(board, registers.WATCHDOG) == 0x1234 for board in (first, second)] == [False, True]
        port.write_quadlet(ALL_BOARDS, registers.WATCHDOG, 0x1111)
        assert [port.read_quadlet(board, registers.WATCHDOG) for board in bench.ids] == [0x1111] * 3
        sample = port.read_block(second, registers.REAL_TIME, 32)
        assert sample.dtype.isnative and registers.board_of(int(sample[blocks.STATUS])) == second
        port.write_block(second, 0x8000, [0x0A000000 | i for i in range(8)])
        assert port.read_block(second, 0x8000, 8).tolist() == [0x0A000000 | i for i in range(8)]
        with pytest.raises(PortError, match="no board 15"):
            port.read_quadlet(15, 0)
        with pytest.raises(PortError, match="allowed: 2 to"):
            port.read_block(second, 0, 1000)


def test_all_boards_are_sampled_and_commanded(bench, protocol):
    with bench.port(protocol) as port:
        port.discover()
        assert eventually_reads(port)
        assert boards_in(port) == list(bench.ids)
        assert (port.blocks[:, port.columns.position] & registers.ENCODER_MASK == registers.ENCODER_ZERO).all()
        port.out[:, :4] = registers.DAC_VALID | 0x8000 + 16 * np.array(bench.ids)[:, np.newaxis]
        port.out[:, 4] = registers.CONTROL_RELAY_ON
        assert port.write_all()
        assert not port.out[:, 4].any() and port.send_ns > 0
        for board in bench.ids:
            assert port.read_quadlet(board, registers.STATUS) & registers.STATUS_RELAY
            assert port.read_quadlet(board, registers.axis_register(2, registers.DAC)) & 0xFFFF == 0x8000 + 16 * board
        assert (port.counters.reads, port.counters.writes) >= (1, 1)


def test_a_lost_reply_leaves_the_last_sample(bench, protocol):
    with bench.port(protocol, deadline_ms=20) as port:
        port.discover()
        assert eventually_reads(port)
        kept, bad = port.blocks.copy(), port.counters.bad_reads
        bench.fault = times(2, lost)  # an unasked reply is asked for once more
        assert not port.read_all()
        assert (port.blocks == kept).all()
        assert port.counters.bad_reads == bad + 1 and port.counters.timeouts and port.bad.any()
        assert port.write_all()
        bench.fault = nothing_wrong
        assert eventually_reads(port)


def test_replies_to_other_requests_are_refused(bench, protocol):
    def mislabelled(_request, replies):
        return [replies[0][:2] + bytes([replies[0][2] ^ 4]) + replies[0][3:]]

    with bench.port(protocol, deadline_ms=20) as port:
        port.discover()
        assert eventually_reads(port)
        kept, stray = port.blocks.copy(), port.counters.stray
        bench.fault = times(2, mislabelled)
        assert not port.read_all()
        assert (port.blocks == kept).all() and port.counters.stray > stray
        bench.fault = nothing_wrong
        assert eventually_reads(port)


def test_a_bus_reset_is_followed(bench, protocol):
    with bench.port(protocol) as port:
        port.discover()
        assert eventually_reads(port)
        bench.reset()
        resets = port.counters.bus_resets
        assert eventually_reads(port)
        assert boards_in(port) == list(bench.ids)
        if bench.network == "bridge":
            assert port.counters.bus_resets > resets
        else:  # nobody uses the FireWire bus
            assert port.counters.bus_resets == port.counters.bad_reads == 0


def test_a_board_may_go_and_come_back(bench, protocol):
    with bench.port(protocol, deadline_ms=20) as port:
        port.discover()
        assert eventually_reads(port)
        bench.take_away(bench.ids[1])
        kept = port.blocks.copy()
        if port._link.by_board:  # without FireWire nothing tells of it
            assert not any(port.read_all() for _ in range(6))
            assert (port.blocks == kept).all()
        else:
            assert eventually_reads(port)
            port._link.cycle_timeout_ms = 5000
            assert all(port.read_all() for _ in range(6))
            port._link.cycle_timeout_ms = 20
            assert port.away.tolist() == [board == bench.ids[1] for board in port.board_ids]
            assert (port.blocks[port.away] == kept[port.away]).all()
        assert port.write_all() or protocol != BROADCAST_QUERY
        bench.take_away(bench.ids[1], gone=False)
        assert any(port.read_all() and not port.away.any() for _ in range(400))
        assert boards_in(port) == list(bench.ids)


def test_counters_start_at_nothing_and_are_cleared(bench):
    with bench.port() as port:
        port.discover()
        counters = port.counters
        assert counters.reads == counters.timeouts == counters.stray == counters.bad_reads == 0
        assert eventually_reads(port)
        counters.clear()
        assert counters.reads == 0 and not counters.board_bad_reads.any()


def test_ports_close_twice_and_say_when_they_are_closed(bench):
    port = bench.port()
    port.close()
    for use in (port.read_all, port.write_all, lambda: port.read_quadlet(bench.ids[0], 0)):
        with pytest.raises(PortError, match="discover"):
            use()
    port.open()
    port.discover()
    port.close()
    port.close()
    with pytest.raises(PortError, match="closed"):
        port.read_quadlet(bench.ids[0], 0)
    with pytest.raises(PortError, match="closed"):
        port.write_quadlet(bench.ids[0], 0, 0)
    port.open()
    assert len(port.discover()) == 3
    assert eventually_reads(port)
    port.close()


def test_a_driven_bus_is_refused_to_another_host(bench):
    with bench.port() as ours, bench.port(exclusive=True) as theirs:
        ours.discover()
        sampled = bench.fault = lambda request, replies: _sampled_just_now(request, replies)
        assert sampled
        with pytest.raises(PortError, match="another host uses this bus"):
            theirs.discover()


def _sampled_just_now(request, replies):
    """Somebody else's samples restart the boards' timers."""
    if request[5] >> 4 == wire.BLOCK_READ and replies:
        return [replies[0][:20] + bytes(4) + replies[0][24:]]
    return replies
