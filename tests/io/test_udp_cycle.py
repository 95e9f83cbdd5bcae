from __future__ import annotations

import select
import time

import numpy as np
import pytest

from tests.fpga import board_side
from tests.io.stub_bus import bus_of, eventually_reads, port_to
from trocar.procs.fpga import blocks, registers, wire
from trocar.procs.io.bus import discovery, link
from trocar.procs.io.bus.protocols import PROTOCOLS, SEQUENTIAL
from trocar.procs.io.bus.transport import PortError


@pytest.fixture(autouse=True)
def quick_scan(monkeypatch):
    """Fourteen silent nodes at 20 ms each would be most of the time here."""
    monkeypatch.setattr(discovery, "SCAN_TIMEOUTS_MS", (2, 20, 100))


@pytest.fixture
def asked_once(monkeypatch):
    """Setup reads wait for a late reply instead of asking again."""
    monkeypatch.setattr(link, "SETUP_TIMEOUT_MS", 5000)


@pytest.fixture(params=PROTOCOLS)
def protocol(request):
    return request.param


def settle(port):
    """A quadlet read behind whatever was written: once it is answered the stub has heard everything."""
    port.read_quadlet(port.board_ids[0], 0)


@pytest.mark.parametrize("firmware", [7, 8, 9])
def test_rows_are_boards_in_every_protocol(protocol, firmware):
    with bus_of(4, firmware) as bus, port_to(bus, protocol) as port:
        port.discover()
        before = time.monotonic_ns()
        assert eventually_reads(port)
        assert before < port.recv_ns < time.monotonic_ns()
        assert (port.blocks[:, blocks.STATUS] >> 24 & 0xF).tolist() == [0, 1, 2, 3]
        position = port.blocks[:, blocks.POSITION]
        assert (position & 0xF).tolist() == [[0, 1, 2, 3]] * 4
        assert (position >> 4 & 0xF).tolist() == [[b] * 4 for b in range(4)]
        motor = port.blocks[:, blocks.MOTOR_STATUS]
        assert (motor == (0 if firmware == 7 else position)).all()
        assert port.blocks.dtype.isnative


def test_commands_reach_their_boards(protocol):
    with bus_of(3) as bus, port_to(bus, protocol) as port:
        port.discover()
        port.out[...] = np.arange(15, dtype=np.uint32).reshape(3, 5) + 0xB0008000
        wanted = port.out.tolist()
        assert port.write_all()
        settle(port)
        for board, row in zip(bus.boards, wanted, strict=True):
            assert board.commands == [board_side.WriteGroup(board.board, tuple(row[:4]), row[4])]
        assert port.out[:, 4].tolist() == [0, 0, 0]
        assert port.out[:, :4].tolist() == [row[:4] for row in wanted]
        assert port.send_ns > 0


def test_rev_7_gets_enables_in_its_control_word(protocol):
    with bus_of(2, firmware=7) as bus, port_to(bus, protocol) as port:
        port.discover()
        port.out[...] = 0x80008000
        port.out[:, 4] = registers.CONTROL_POWER_ON
        port.out[1, 0] |= registers.DAC_AMP_MASK | registers.DAC_AMP_ENABLE
        port.out[1, 3] |= registers.DAC_AMP_MASK
        assert port.write_all()
        settle(port)
        assert bus.boards[0].commands[-1] == board_side.WriteGroup(0, (0x80008000,) * 4, 0x000C0000)
        assert bus.boards[1].commands[-1] == board_side.WriteGroup(1, (0x81008000,) * 4, 0x000C0901)


def test_datagrams_do_not_grow_with_boards(asked_once):
    for count in (2, 12):
        with bus_of(count) as bus, port_to(bus, deadline_ms=5000) as port:
            port.discover()
            settle(port)
            heard = len(bus.heard)
            assert port.read_all() and port.write_all()
            settle(port)
            assert len(bus.heard) - heard - 1 == 3


def test_boards_that_were_asked_are_not_asked_again(asked_once):
    with bus_of(4) as bus, port_to(bus, deadline_ms=5000) as port:
        port.discover()
        settle(port)
        heard = len(bus.heard)
        port.ask_all()
        assert port.read_all() and port.read_all()
        settle(port)
        kinds = [board_side.decode_request(each).tcode for each in bus.heard[heard:-1]]
        assert kinds == [wire.QUADLET_WRITE, wire.BLOCK_READ] * 2


def test_a_port_that_spins_reads_and_misses_like_one_that_sleeps(protocol):
    with bus_of(3) as bus, port_to(bus, protocol, spin_ns=50_000) as port:
        port.discover()
        assert eventually_reads(port)
        timeouts = port.counters.timeouts
        bus.fault = lose(lambda request, replies: [], times=1)
        assert not port.read_all()
        assert port.counters.timeouts == timeouts + 1
        assert eventually_reads(port)


def lose(kind, times):
    """A fault that swallows so many replies to block reads, or passes them through `kind`."""
    left = [times]

    def fault(request, replies):
        if request.tcode != wire.BLOCK_READ or left[0] == 0:
            return replies
        left[0] -= 1
        return kind(request, replies)

    return fault


def mangled(**changes):
    def kind(request, replies):
        response = board_side.decode_response(replies[0])
        fields = {name: getattr(response, name) for name in ("tcode", "node", "tl", "data", "trailer")}
        return [board_side.encode_response(board_side.WireResponse(**(fields | {k: v(fields[k]) for k,
                                                                          v in changes.items()})))]

    return kind


@pytest.mark.parametrize(
    "kind",
    [
        mangled(tl=lambda tl: (tl + 1) % 64),
        mangled(node=lambda node: node ^ 1),
        mangled(data=lambda data: data[:-4]),
        mangled(data=lambda data: data + b"1234"),
        mangled(tcode=lambda _: wire.QUADLET_RESPONSE, data=lambda data: data[:4]),
        lambda request, replies: [b"noise" * 30],
        lambda request, replies: [b""],
        lambda request, replies: [board_side.encode_trailer(board_side.Trailer(wire.DROPPED, 3))],
    ],
)  # fmt: skip
def test_wrong_replies_are_bad_reads(protocol, kind):
    with bus_of(2) as bus, port_to(bus, protocol) as port:
        port.discover()
        assert eventually_reads(port)
        kept = port.blocks.copy()
        bus.fault = lose(kind, 1)
        assert not port.read_all()
        assert (port.blocks == kept).all()
        assert eventually_reads(port)


def spoil(row, quad, bits):
    def kind(request, replies):
        data = bytearray(replies[0])
        at = 20 + 4 * (33 * row + quad)
        word = int.from_bytes(data[at : at + 4], "big") ^ bits
        data[at : at + 4] = word.to_bytes(4, "big")
        return [bytes(data)]

    return kind


@pytest.mark.parametrize(
    ("quad", "bits", "sequence"),
    [(0, 0x00010000, True), (0, 0x8000, True), (0, 0x01000000, True), (2, 0x01000000, False), (2, 0x10000000, False)],
)
def test_a_wrong_hub_block_names_its_board(quad, bits, sequence):
    with bus_of(3) as bus, port_to(bus) as port:
        port.discover()
        assert eventually_reads(port)
        kept, before = port.blocks.copy(), port.counters.board_bad_reads.copy()
        bus.fault = lose(spoil(1, quad, bits), 1)
        assert not port.read_all()
        assert (port.blocks == kept).all()
        assert port.bad.tolist() == [False, True, False]
        assert (port.counters.board_bad_reads - before).tolist() == [0, 1, 0]
        assert port.counters.board_sequence_errors.tolist() == [0, int(sequence), 0]
        assert port.counters.sequence_errors == sequence


def test_a_wrong_board_in_sequence_is_named():
    with bus_of(3) as bus, port_to(bus, SEQUENTIAL) as port:
        port.discover()
        assert eventually_reads(port)
        bus.fault = lose(spoil(0, 1, 0x01000000), 1)
        assert not port.read_all()
        assert port.bad.tolist() == [True, False, False]


def test_a_bus_reset_is_followed(protocol):
    with bus_of(4) as bus, port_to(bus, protocol) as port:
        port.discover()
        assert eventually_reads(port)
        for board in bus.boards:
            board.node = (board.node + 2) % 4
        bus.generation = 7
        assert not port.read_all()
        assert port.counters.dropped == 1
        assert port.write_all()
        assert eventually_reads(port)
        assert port.counters.bus_resets >= 1
        assert [port.info(b.board).node for b in bus.boards] == [b.node for b in bus.boards]
        assert (port.blocks[:, blocks.STATUS] >> 24 & 0xF).tolist() == [0, 1, 2, 3]
        assert port.read_quadlet(3, registers.STATUS) >> 24 & 0xF == 3


def test_a_board_lost_in_a_reset_is_away_and_the_others_go_on(protocol, monkeypatch):
    monkeypatch.setattr(discovery, "PROBE_NS", 1 << 62)
    with bus_of(3) as bus, port_to(bus, protocol) as port:
        port.discover()
        port._link.cycle_timeout_ms = 20  # a busy machine is no late board
        assert eventually_reads(port)
        gone = bus.boards.pop()
        bus.generation = 4
        kept = port.blocks[2].copy()
        assert not port.read_all() and not port.away.any()
        assert eventually_reads(port, tries=8)
        assert port.away.tolist() == port.bad.tolist() == [False, False, True]
        port._link.cycle_timeout_ms = 5000
        before = port.counters.timeouts, port.counters.dropped
        port.blocks[:2] = 0
        assert all(port.read_all() for _ in range(100))
        assert (port.counters.timeouts, port.counters.dropped) == before, "the one that is away is not waited for"
        assert (port.blocks[:, blocks.STATUS] >> 24 & 0xF).tolist() == [0, 1, 2] and (port.blocks[2] == kept).all()
        assert not port.counters.board_bad_reads.any(), "a bus reset is no board's fault"
        heard = len(bus.boards[0].commands)
        assert port.write_all()
        settle_broadcast(port, bus, heard)
        port._link.cycle_timeout_ms = 20
        bus.boards.append(gone)
        bus.generation = 5
        assert any(port.read_all() and not port.away.any() for _ in range(50))


def test_a_board_whose_replies_were_lost_after_a_reset_is_found_later(monkeypatch):
    with bus_of(2) as bus, port_to(bus) as port:
        port.discover()
        port._link.cycle_timeout_ms = 20
        monkeypatch.setattr("trocar.procs.io.bus.discovery.PROBE_NS", 50_000_000)
        gone = bus.boards.pop()
        bus.generation = 4
        assert eventually_reads(port) and port.away.tolist() == [False, True]
        bus.boards.append(gone)  # no reset tells of it
        assert any(not select.poll().poll(5) and port.read_all() and not port.away.any() for _ in range(200))


def settle_broadcast(port, bus, heard):
    deadline = time.monotonic() + 10
    while len(bus.boards[0].commands) == heard:
        assert time.monotonic() < deadline
        select.poll().poll(1)


def test_set_up_reads_survive_losses():
    with bus_of(1) as bus, port_to(bus) as port:
        port.discover()
        left = [2]

        def fault(request, replies):
            left[0] -= 1
            return [] if left[0] >= 0 else replies

        bus.fault = fault
        assert port.read_quadlet(0, registers.HARDWARE_ID) == registers.QLA1
        bus.fault = lambda request, replies: []
        with pytest.raises(PortError, match="0x0004 is not answered"):
            port.read_quadlet(0, registers.HARDWARE_ID)


def test_a_hub_that_went_away_is_a_bad_read(protocol):
    with bus_of(2) as bus, port_to(bus, protocol) as port:
        port.discover()
    with pytest.raises(PortError, match="not discovered"):
        port.read_all()
    with bus_of(2) as bus:
        port = port_to(bus, protocol, deadline_ms=2)
        port.open()
        port.discover()
    for _ in range(5):
        assert not port.read_all()
        port.write_all()
    port.close()


def test_a_hub_that_came_back_hears_the_first_write():
    with bus_of(1) as bus:
        port = port_to(bus)
        port.open()
        port.discover()
    for _ in range(3):
        port.read_all()
        port.write_all()
    with bus_of(1, address=bus.address, port=bus.port) as again:
        assert port.write_all()
        settle(port)
        assert len(again.boards[0].commands) == 1
    port.close()


def test_sequence_numbers_wrap_past_zero():
    with bus_of(1) as bus, port_to(bus, deadline_ms=5000) as port:
        port.discover()
        port._link.sequence = 0xFFFE
        assert port.read_all() and port.read_all()
        queries = [v >> 16 for a, v in bus.boards[0].writes if a == registers.QUERY]
        assert queries == [0xFFFF, 1]
