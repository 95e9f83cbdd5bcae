"""The host's side with every kind of controller, alone and mixed on one bus, in every protocol."""

from __future__ import annotations

import time

import numpy as np
import pytest

from tests.fpga import board_side
from tests.io.controllers_bus import ControllersBus, controller
from tests.io.stub_bus import StubBoard, StubBus, eventually_reads, udp_port_to
from trocar.procs.fpga import blocks, registers
from trocar.procs.io.bus import discovery
from trocar.procs.io.bus.protocols import BROADCAST_QUERY, PROTOCOLS, SEQUENTIAL
from trocar.procs.io.bus.transport import PortError

MIXED = "all together"
BUSES = {
    "QLA1": (controller(3), controller(5)),
    "DQLA": (controller(0, "DQLA", 9), controller(4, "DQLA", 9)),
    "dRA1": (controller(6, "dRA1"), controller(8, "dRA1")),
    "one dRA1": (controller(0, "dRA1", 9),),
    MIXED: (controller(1), controller(2, "DQLA"), controller(6, "dRA1"), controller(7)),
    "Rev 8 and 9": (controller(1), controller(2, "QLA1", 9), controller(4, "DQLA", 9)),
}


@pytest.fixture(autouse=True)
def quick_scan(monkeypatch):
    monkeypatch.setattr(discovery, "SCAN_TIMEOUTS_MS", (10, 50, 100))


@pytest.fixture(params=[name if name == MIXED else pytest.param(name, marks=pytest.mark.slow) for name in BUSES])
def boards(request):
    with ControllersBus(*BUSES[request.param]) as bus:
        yield bus


@pytest.fixture(params=PROTOCOLS)
def protocol(request):
    return request.param


def port_to(bus, protocol=BROADCAST_QUERY, ids=None):
    # A hub of Rev 9 has the base address plus its board id: hubs here have another revision or board id 0.
    return udp_port_to(f"udpfw:{bus.address}", ids or bus.ids, time.monotonic_ns, protocol, udp_port=bus.port,
                   exclusive=False, deadline_ms=200)


def test_rows_have_what_their_boards_sent(boards, protocol):
    lines = boards.bus.lines
    rng = np.random.default_rng(3)
    adc = rng.integers(0, 0x1000, lines.adc.shape, dtype=np.uint32)
    with port_to(boards, protocol) as port:
        found = port.discover()
        assert port.hardware == tuple(info.hardware for info in found if info.board in boards.ids)
        lines.adc[...] = adc
        assert eventually_reads(port)
        for row, board in enumerate(boards.ids):
            motors, encoders = blocks.AXES_OF[port.hardware[row]]
            status = int(port.blocks[row, blocks.STATUS])
            assert (registers.board_of(status), registers.axes_of(status)) == (board, motors)
            position = port.blocks[row, port.columns.position][:encoders]
            assert ((position & registers.ENCODER_MASK) == registers.ENCODER_ZERO).all()
            # what a board does not have stays 0, whatever its neighbours have
            assert not port.blocks[row, port.columns.motor_status][motors:].any()
            assert not port.blocks[row, port.columns.running][encoders:].any()
            assert (port.blocks[row, port.columns.adc][:motors] != 0).all()


def test_every_motor_and_every_board_get_their_own_words(boards, protocol):
    with port_to(boards, protocol) as port:
        port.discover()
        wanted = {}
        for row, board in enumerate(boards.ids):
            motors = blocks.AXES_OF[port.hardware[row]][0]
            words = [registers.DAC_VALID | 0x8000 + 16 * row + motor for motor in range(motors)]
            port.out[row, :motors], port.out[row, -1] = words, registers.CONTROL_RELAY_ON
            wanted[board] = board_side.WriteGroup(board, tuple(words), registers.CONTROL_RELAY_ON)
        assert port.write_all()
        assert not port.out[:, -1].any()
        for board in boards.ids:
            assert port.read_quadlet(board, registers.STATUS) & registers.STATUS_RELAY
        assert {group.board: group for group in boards.groups} == wanted
        assert len(boards.groups) == len(wanted)


def test_more_than_one_datagram_holds_is_refused_with_the_protocol_that_could():
    many = [controller(board, "DQLA") for board in range(8)]
    with ControllersBus(*many) as bus, port_to(bus, SEQUENTIAL) as port:
        assert len(port.discover()) == 8
        assert eventually_reads(port)
    with StubBus([StubBoard(board, board, hardware=registers.DQLA) for board in range(9)]) as crowded:
        port = udp_port_to(f"udp:{crowded.address}", range(9), time.monotonic_ns, udp_port=crowded.port,
                           exclusive=False)
        with port, pytest.raises(PortError) as caught:
            port.discover()
        assert "9 boards do not fit" in str(caught.value) and SEQUENTIAL in str(caught.value)
