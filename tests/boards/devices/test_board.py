"""Which device of a board stands behind which address."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.examples import examples
from trocar.procs.boards.controllers.models import Model
from trocar.procs.boards.devices.board import Board
from trocar.procs.boards.devices.dallas import instrument_memory
from trocar.procs.boards.devices.outputs import PLAY
from trocar.procs.document.system import Controller
from trocar.procs.fpga import registers as reg

MS = 49152


def made(node: int, firmware: int, serial: str, *, fpga: int = 2, board_id: int = 0) -> Board:
    """A QLA1 controller."""
    return Board(Model.of(node, Controller(board_id, "QLA1", firmware, f"V{fpga}", serial)))


def quads(board: Board, address: int, count: int, tick: int) -> list[int]:
    return list(struct.unpack(f">{count}I", board.read_block(address, 4 * count, tick)))


def fill(board: Board, address: int, *values: int, tick: int = 0) -> None:
    board.write_block(address, struct.pack(f">{len(values)}I", *values), tick)


def test_identity_and_network_are_told() -> None:
    board = made(3, 9, "", fpga=3, board_id=7)
    assert (board.read(reg.HARDWARE_ID, 0), board.read(reg.FIRMWARE, 0)) == (reg.QLA1, 9)
    assert reg.fpga_of(board.read(reg.ETHERNET, 0)) == 3
    board.write(reg.IP_ADDRESS, 0x0100_007F, 0)
    assert board.read(reg.IP_ADDRESS, 0) == 0x0800_007F
    board.write(reg.PHY_REQUEST, 0, 0)
    assert board.read(reg.PHY_RESPONSE, 0) == 3 << 2
    assert board.read(0x40A0, 0) == 0x3057_5345
    assert board.read(0x5200, 0) == board.read(0x1801, 0) == board.read(0xB000, 0) == 0
    board.write(reg.ETHERNET, 1 << 26 | 1 << 7, 0)
    assert board.read(reg.ETHERNET, 0) & 0xFF == 0


def test_relayed_writes_alone_reach_the_chip_of_v2() -> None:
    board = made(0, 8, "")
    board.write(reg.ETHERNET, 0x01C0_0000, 0, relayed=False)
    assert board.read(reg.ETHERNET, 0) == 0xA01C_0000
    board.write(reg.ETHERNET, 0x01C0_0000, 0)
    assert board.read(reg.ETHERNET, 0) == 0xA01C_8872


@pytest.mark.parametrize("fpga", [2, 3])
def test_fpga_prom_is_at_its_registers_and_buffer(fpga: int) -> None:
    board = made(0, 8, "1234-56", fpga=fpga)
    board.write(reg.PROM_COMMAND, 0x031F_FF00, 0)
    assert bool(board.read(reg.PROM_COMMAND, 1000)) == (fpga == 2)
    assert board.read(reg.PROM_COMMAND, MS) == 0
    assert board.read(reg.PROM_RESULT, MS) == 64
    assert board.read_block(reg.FPGA_PROM, 12, MS) == b"FPGA 1234-56"
    assert board.read(reg.FPGA_PROM + 1, MS) == int.from_bytes(b" 123", "big")


def test_page_is_programmed_by_a_block_write() -> None:
    board = made(0, 8, "")
    board.write(reg.PROM_COMMAND, 0x0600_0000, 0)
    fill(board, reg.FPGA_PROM, 0x0200_0100, 0x0102_0304, tick=MS)
    board.write(reg.PROM_COMMAND, 0x0300_0100, 2 * MS)
    assert quads(board, reg.FPGA_PROM, 2, 3 * MS) == [0x0102_0304, 0xFFFF_FFFF]


@pytest.mark.parametrize(("firmware", "channel", "heard"), [
    (8, 0, True), (8, 0x10, True), (7, 0, True), (7, 0x10, False)])
def test_qla_prom_looks_at_channel_bits_on_rev_7_only(firmware: int, channel: int, heard: bool) -> None:
    board = made(0, firmware, "4711-08")
    board.write(reg.QLA_PROM_COMMAND | channel, 0xFE00_0002, 0)
    assert (board.read(0x3001 | channel, 100), board.read(0x3002 | channel, 100)) == (2 if heard else 0, 0)
    assert board.read(0x3100 | channel, MS) == (int.from_bytes(b"QLA ", "big") if heard else 0)
    data = board.read_block(reg.QLA_PROM_BUFFER, 12, MS)
    assert data == (b"QLA 4711-08\0" if heard else bytes(12))
    assert board.read(reg.QLA_PROM_RESULT, MS) == (int.from_bytes(b"-08\0", "big") if heard else 0)
    assert board.read(0x3003, MS) == board.read(0x3200, MS) == 0


def test_qla_prom_buffer_is_filled_by_blocks_and_quadlets() -> None:
    board = made(0, 8, "")
    fill(board, reg.QLA_PROM_BUFFER, 0x4142_4344, 0x4546_4748)
    board.write(reg.QLA_PROM_BUFFER + 1, 0x6162_6364, 0)
    board.write(reg.QLA_PROM_COMMAND, 0x0600_0000, 0)
    board.write(reg.QLA_PROM_COMMAND, 0xFF00_4001, 0)
    board.write(reg.QLA_PROM_COMMAND, 0xFE00_4001, 10 * MS)
    assert board.read_block(reg.QLA_PROM_BUFFER, 8, 11 * MS) == b"ABCDabcd"
    fill(board, 0x3200, 1, 2)
    assert board.read(0x3200, 0) == 0


def test_instrument_is_read_through_its_register_and_buffer() -> None:
    board = made(0, 8, "")
    memory = instrument_memory("PROGRASP_FORCEPS", 420093, 1)
    board.dallas.insert(memory, 0)
    board.write(reg.DALLAS, 0x0080_0002, 0)
    assert board.read(reg.DALLAS, 1) & 0x20F0
    assert board.read(reg.DALLAS, 500 * MS) & 0xFF00_20F7 == 0x0B00_0003
    assert board.read_block(reg.DALLAS_MEMORY, 256, 500 * MS) == memory[0x80:0x180]


def test_digital_outputs_and_their_table_are_in_place() -> None:
    board = made(0, 8, "")
    board.write(reg.DIGITAL_OUTPUT, 0x0F05, 0)
    assert (board.read(reg.DIGITAL_OUTPUT, 0), board.digital.levels(0)) == (5, 5)
    fill(board, reg.WAVEFORM, 1 << 31 | 99 << 8 | 0xA, 1, 2)
    board.write(reg.WAVEFORM + 2, 3, 0)
    assert quads(board, reg.WAVEFORM, 3, 0) == [1 << 31 | 99 << 8 | 0xA, 1, 3]
    board.write(reg.DIGITAL_OUTPUT, PLAY | 0xF00, 1000)
    assert board.read(reg.DIGITAL_OUTPUT, 1099) == PLAY | 1 << 30 | 0xA
    assert board.digital.levels(1099) == 0xA
    assert board.read(reg.DIGITAL_OUTPUT, 1101) == board.digital.levels(1101) == 0


def test_collected_data_and_their_status_are_in_place() -> None:
    board = made(0, 8, "")
    board.collection.command(2, reg.DAC_COLLECT | 0x1234, 5)
    assert quads(board, reg.DATA_BUFFER, 2, 6) == [5 << 16 | 0x1234, 0]
    assert board.read(reg.DATA_BUFFER_STATUS, 6) == 0x8800


def test_time_does_not_go_back() -> None:
    board = made(0, 8, "1234-56")
    board.write(reg.PROM_COMMAND, 0x031F_FF00, 0)
    assert board.read(reg.PROM_COMMAND, MS) == 0
    assert board.read_block(reg.FPGA_PROM, 4, MS) == b"FPGA"
    fill(board, reg.WAVEFORM, 1 << 31, tick=10)
    assert board.read(reg.WAVEFORM, 0) == 1 << 31


ADDRESSES = st.one_of(st.integers(0, 0xF), st.builds(lambda region, offset: region << 12 | offset, st.integers(0, 15),
                                                     st.one_of(st.integers(0, 0x120), st.integers(0, 0xFFF))))


@examples(200)
@given(st.sampled_from(((7, 2), (8, 2), (8, 3), (9, 2), (9, 3))), st.lists(st.tuples(
    ADDRESSES, st.integers(0, 0xFFFF_FFFF), st.integers(0, 30), st.integers(0, 99 * MS)), max_size=30))
@pytest.mark.slow
def test_any_access_is_answered(kind: tuple[int, int], accesses: list[tuple[int, int, int, int]]) -> None:
    board, tick = made(62, kind[0], "", fpga=kind[1], board_id=15), 0
    for address, value, size, wait in accesses:
        tick += wait
        board.write(address, value, tick)
        board.write_block(address, (value.to_bytes(4, "big") * 8)[:size], tick)
        assert len(board.read_block(address, size, tick)) == size // 4 * 4
        assert 0 <= board.read(address, tick) < 1 << 32
    assert board.read(reg.FIRMWARE, tick) == kind[0]
