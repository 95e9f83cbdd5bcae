"""Who answers what: addressing, drop rules, discovery, registers, hub and real-time blocks."""

from __future__ import annotations

import numpy as np
import pytest

from tests.fpga import board_side
from trocar.procs.boards.controllers.bus import EmulatedBus
from trocar.procs.document.system import Controller
from trocar.procs.fpga import registers as reg
from trocar.procs.fpga import wire


class FirmwareHost:
    """Speaks to a bus on a clock that moves only when told."""

    def __init__(self, *ids: int, serial: str = "1234-56") -> None:
        self.bus = EmulatedBus(tuple(Controller(board, serial=serial) for board in ids))
        self.tick = 0

    def ask(self, request: bytes) -> board_side.WireResponse | None:
        reply = self.bus.answer(request, self.tick)
        if reply is None:
            return None
        response = board_side.decode_response(reply)
        assert isinstance(response, board_side.WireResponse)
        return response

    def read(self, node: int, address: int, flags: int = 0) -> int | None:
        response = self.ask(wire.quadlet_read(node, address, 5, self.bus.generation, flags))
        return None if response is None else response.value

    def write(self, node: int, address: int, value: int, flags: int = 0) -> None:
        assert self.ask(wire.quadlet_write(node, address, value, 5, self.bus.generation, flags)) is None

    def block(self, node: int, address: int, length: int) -> np.ndarray:
        response = self.ask(wire.block_read(node, address, length, 7, self.bus.generation))
        assert response is not None
        assert len(response.data) == length
        return np.frombuffer(response.data, ">u4").astype(np.int64)

    def write_block(self, node: int, *quads: int, flags: int = 0) -> None:
        data = np.array(quads, dtype=">u4").tobytes()
        assert self.ask(wire.block_write(node, 0, data, 5, self.bus.generation, flags)) is None


def test_another_bus_generation_drops_reads_with_a_trailer() -> None:
    host = FirmwareHost(0)
    other = host.bus.generation + 2
    reply = host.bus.answer(wire.quadlet_read(0, reg.STATUS, 1, other), 0)
    dropped = board_side.decode_response(reply or b"")
    assert isinstance(dropped, board_side.Dropped)
    assert dropped.trailer.flags == wire.DROPPED
    assert dropped.trailer.generation == host.bus.generation
    assert host.bus.answer(wire.quadlet_write(0, reg.WATCHDOG, 5, 1, other), 0) is None
    assert host.read(0, reg.WATCHDOG) == 0x1680
    assert host.bus.answer(wire.quadlet_read(wire.BROADCAST, reg.STATUS, 1, other), 0) is not None


def test_discovery_registers_are_those_of_a_rev_8_board() -> None:
    host = FirmwareHost(4)
    host.write(wire.BROADCAST, reg.IP_ADDRESS, 0x0100007F, wire.NO_FORWARD)
    assert host.read(0, reg.IP_ADDRESS) == 0x0100007F
    assert host.read(0, reg.FIRMWARE) == 8
    assert reg.fpga_of(host.read(0, reg.ETHERNET) or 0) == 2
    assert host.read(0, reg.GIT_DESCRIPTION) == 0
    host.write(wire.BROADCAST, reg.PHY_REQUEST, 1)
    assert host.read(0, reg.PHY_RESPONSE) == 1 << 8 | 63
    host.write(wire.BROADCAST, reg.PHY_REQUEST, 0x1100 | 7)
    host.write(wire.BROADCAST, reg.PHY_REQUEST, 1)
    assert host.read(0, reg.PHY_RESPONSE) == 1 << 8 | 7


def test_unknown_addresses_read_zero_and_swallow_writes() -> None:
    host = FirmwareHost(4)
    for address in (0x12, 0x1E, 0x2F, 0x55, 0x8F, 0x9000, 0xA000, 0x4000):
        host.write(0, address, 0xFFFFFFFF)
        assert host.read(0, address) == 0
    host.write(0, reg.HARDWARE_ID, 1)
    assert host.read(0, reg.HARDWARE_ID) == reg.QLA1


def test_axis_registers_power_up_as_documented() -> None:
    host = FirmwareHost(4)
    values = {reg.DAC: 0x8000, reg.ENCODER_PRELOAD: 0x800000, reg.MOTOR_CONFIG: 0x01780418,
              reg.MOTOR_STATUS: 0x00108000, reg.PERIOD: 0xCBFFFFFF, reg.QUARTER_1: 0x43FFFFFF,
              reg.QUARTER_5: 0x43FFFFFF, reg.RUNNING: 0x83FFFFFF}
    for axis in range(4):
        assert {offset: host.read(0, reg.axis_register(axis, offset)) for offset in values} == values
    assert (host.read(0, reg.axis_register(2, reg.ENCODER)) or 0) & 0x1FFFFFF == 0x800000


def test_preload_example_sets_axis_1_of_node_0() -> None:
    host = FirmwareHost(4)
    request = bytes.fromhex("0001" + "ffc08c00ffd000000000001400801000" + "47f33fd7")  # F.7, our generation
    host.bus.answer(request, 0)
    assert (host.read(0, 0x15) or 0) & 0xFFFFFF == 0x801000
    assert (host.read(0, 0x25) or 0) & 0xFFFFFF == 0x800000


def test_real_time_block_has_32_quads_and_restarts_the_time_stamp() -> None:
    host = FirmwareHost(4, 6)
    host.tick = 1000
    host.block(0, reg.REAL_TIME, 128)
    host.tick = 5000
    block = host.block(0, reg.REAL_TIME, 128)
    assert block[0] == 3999
    assert reg.board_of(int(block[1])) == 4
    assert block[2] & 0xFFF == 0xFFF
    assert block[3] & 0xFFFF == 0x3C3E
    assert host.block(1, reg.REAL_TIME, 128)[0] == 5000
    assert (block[28:32] == 0x00108000).all()
    assert (block[12:16] == 0xCBFFFFFF).all()


@pytest.mark.parametrize("ids", [(0,), (0, 1), (9, 3, 12), tuple(range(10)), tuple(range(15, 0, -1))])
def test_hub_read_has_every_board_in_ascending_order(ids: tuple[int, ...]) -> None:
    host = FirmwareHost(*ids)
    mask = sum(1 << board for board in ids)
    for sequence in (1, 0x1FF):
        host.tick += 33_000
        host.write(wire.BROADCAST, reg.QUERY, sequence << 16 | mask)
        quads = host.block(0, reg.HUB, (33 * len(ids) + 1) * 4)
        blocks = quads[:-1].reshape(-1, 33)
        assert (blocks[:, 0] >> 24 == 33).all()
        assert (blocks[:, 0] >> 16 & 0xFF == sequence & 0xFF).all()
        assert (np.diff(blocks[:, 0] & 0x3FFF) > 0).all()
        assert [reg.board_of(int(status)) for status in blocks[:, 2]] == sorted(ids)
        assert quads[-1] != 0
    assert (blocks[:, 1] == 32_999).all()


def test_hub_read_of_some_boards_leaves_the_others_out() -> None:
    host = FirmwareHost(2, 5, 7)
    host.tick = 100
    host.write(wire.BROADCAST, reg.QUERY, 6 << 16 | 1 << 7 | 1 << 2)
    quads = host.block(0, reg.HUB, 67 * 4)
    assert [reg.board_of(int(q)) for q in (quads[2], quads[35])] == [2, 7]
    host.tick = 300
    assert host.block(1, reg.REAL_TIME, 128)[0] == 300  # board 5 was not sampled by the query
    host.write(wire.BROADCAST, reg.QUERY, 7 << 16 | 1 << 7 | 1 << 4)
    quads = host.block(0, reg.HUB, 67 * 4)
    assert (quads[0], quads[66]) == (0, 0)  # board 4 is not there: no block, no timing


def test_parts_of_hub_memory_can_be_read() -> None:
    host = FirmwareHost(2, 5)
    host.write(wire.BROADCAST, reg.QUERY, 6 << 16 | 0x24)
    whole = host.block(0, reg.HUB, 67 * 4)
    assert (host.block(0, reg.HUB + 33, 33 * 4) == whole[33:66]).all()
    assert host.read(0, reg.HUB + 1) == whole[1]
    assert (host.block(0, reg.HUB, 70 * 4)[67:] == 0).all()


def test_broadcast_write_reaches_each_board_by_its_id() -> None:
    host = FirmwareHost(5, 0)
    host.write_block(wire.BROADCAST, 0x006, 0x80008100, 0x80008200, 0x80008300, 0x80008400, 0,
                     0x506, 0x80008101, 0x80008201, 0x80008301, 0x00008401, 0)
    assert [host.read(1, reg.axis_register(k, reg.DAC)) for k in range(4)] == [0x8100, 0x8200, 0x8300, 0x8400]
    assert [host.read(0, reg.axis_register(k, reg.DAC)) for k in range(4)] == [0x8101, 0x8201, 0x8301, 0x8000]
    assert host.read(0, reg.axis_register(0, reg.MOTOR_STATUS)) == 0x00108101


def test_groups_of_absent_boards_are_stepped_over() -> None:
    host = FirmwareHost(1)
    host.write_block(wire.BROADCAST, 0x706, 0x80009000, 0, 0, 0, 0, 0x106, 0x80008101, 0, 0, 0, 0)
    assert host.read(0, reg.axis_register(0, reg.DAC)) == 0x8101
    host.write_block(0, 0x206, 0x80009000, 0, 0, 0, 0)  # addressed to the node, meant for another id
    assert host.read(0, reg.axis_register(0, reg.DAC)) == 0x8101


@pytest.mark.parametrize("ids", [(), (3, 3), (16,)])
def test_impossible_sets_of_boards_are_refused(ids: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="allowed"):
        FirmwareHost(*ids)
