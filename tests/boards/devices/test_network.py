"""Ethernet status and control, IP address, PHY requests and the blocks the test programs look at."""

from __future__ import annotations

import pytest

from trocar.procs.boards.devices import network
from trocar.procs.boards.devices.network import Network
from trocar.procs.boards.devices.phy import MDIO_TICKS
from trocar.procs.fpga import registers as reg

MS = 49152


def v2(firmware: int = 8) -> Network:
    return Network(2, firmware, 5, 1)


def v3(firmware: int = 9) -> Network:
    return Network(3, firmware, 5, 1)


def status(board: Network, tick: int = 0) -> int:
    return board.read(reg.ETHERNET, tick)


@pytest.mark.parametrize(("fpga", "firmware", "value"), [
    (2, 7, 0xA01C_0000), (2, 8, 0xA01C_0000), (2, 9, 0xA01C_0000), (3, 8, 0x40B0_B0B0), (3, 9, 0x40B1_A0A0)])
def test_status_at_rest_is_that_of_the_real_boards(fpga: int, firmware: int, value: int) -> None:
    board = Network(fpga, firmware, 0, 0)
    assert status(board) == value
    assert reg.fpga_of(value) == fpga


@pytest.mark.parametrize("fpga", [0, 1, 4])
def test_other_fpgas_are_refused(fpga: int) -> None:
    with pytest.raises(ValueError, match="allowed: 2 and 3"):
        Network(fpga, 8, 0, 0)


@pytest.mark.parametrize(("firmware", "written", "read"), [
    (7, 0x0100_007F, 0x0100_007F), (8, 0x0100_007F, 0x0100_007F), (9, 0x0100_007F, 0x0600_007F),
    (9, 0xFE00_007F, 0x0300_007F), (9, 0xFFFF_FFFF, 0xFFFF_FFFF)])
def test_rev_9_adds_its_board_id_to_the_address(firmware: int, written: int, read: int) -> None:
    board = v2(firmware)
    assert board.read(reg.IP_ADDRESS, 0) == 0xFFFF_FFFF
    board.write(reg.IP_ADDRESS, written, 0)
    assert board.read(reg.IP_ADDRESS, 0) == read


def test_phy_registers_are_asked_for_and_answered() -> None:
    board = v2()
    board.write(reg.PHY_REQUEST, 0, 0)
    assert board.read(reg.PHY_RESPONSE, 0) == 1 << 2
    board.write(reg.PHY_REQUEST, 1, 0)
    assert board.read(reg.PHY_RESPONSE, 0) == 0x13F
    assert board.read(reg.PHY_REQUEST, 0) == 1
    assert board.read(reg.STATUS, 0) == 0


# -- control -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("board", [v2(), v3()])
def test_network_errors_stay_until_cleared(board: Network) -> None:
    good = status(board)
    board.errors = network.DESTINATION_ERROR | network.PORT_ERROR
    assert status(board) == good | 0x0600_0000
    board.write(reg.ETHERNET, 1 << 26 if good >> 31 else 1 << 30, 0, relayed=False)
    assert status(board) == good | 0x0600_0000
    board.write(reg.ETHERNET, network.CLEAR_NETWORK, 0, relayed=False)
    assert status(board) == good


def test_link_errors_of_v2_have_their_own_bit() -> None:
    board = v2()
    board.errors = network.LINK_ERROR | network.FRAME_ERROR
    board.write(reg.ETHERNET, network.CLEAR_LINK, 0, relayed=False)
    assert board.errors == network.LINK_ERROR | network.FRAME_ERROR
    board.write(reg.ETHERNET, network.CLEAR_LINK, 0)
    assert board.errors == network.FRAME_ERROR


def test_v2_chip_registers_are_reached_over_firewire() -> None:
    board = v2()
    board.write(reg.ETHERNET, 0x01C0_0000, 0)
    assert status(board) == 0xA01C_8872
    board.write(reg.ETHERNET, 0x0110_0000, 0, relayed=False)
    assert status(board) & 0xFFFF == 0x8872
    board.write(reg.ETHERNET, 0x0010_0000, 0)
    assert status(board) & 0xFFFF == 0x05
    board.write(reg.ETHERNET, 0x0320_1234, 0)
    board.write(reg.ETHERNET, 0x0110_0000, 0)
    board.write(reg.ETHERNET, 0x0120_0000, 0)
    assert status(board) == 0xA01C_1234
    board.write(reg.ETHERNET, 0x0910_0000, 0)  # direct memory access
    board.write(reg.ETHERNET, 0x4110_0000, 0)
    assert status(board) == 0xA01C_1234


def test_v2_reset_takes_the_link_for_a_while() -> None:
    board = v2()
    board.write(reg.ETHERNET, 0x0320_1234, 0)
    board.write(reg.ETHERNET, 1 << 26, 100)
    end = 100 + network.V2_RESET_TICKS
    assert status(board, 100) == status(board, end - 1) == 0x8010_1234
    assert status(board, end) == 0xA014_1234
    linked = 100 + network.LINK_TICKS
    assert [board.linked(tick) for tick in (100, linked - 1, linked)] == [False, False, True]
    assert v2().linked(0)
    board.write(reg.ETHERNET, 0x01C0_0000, end - 1)
    assert status(board, linked) == 0xE01C_1234  # not possible meanwhile: request error
    board.write(reg.ETHERNET, 0x0120_0000 | 0, linked)
    assert status(board, linked) == 0xE01C_0000


@pytest.mark.parametrize(("bits", "down"), [(0, ()), (0x80, (0,)), (0x8000, (1,)), (0x8080, (0, 1))])
def test_v3_reset_takes_the_ports_it_names(bits: int, down: tuple[int, ...]) -> None:
    board = v3()
    board.write(reg.ETHERNET, bits, 50)
    assert status(board, 50) == 0x40B1_A0A0
    board.write(reg.ETHERNET, 1 << 26 | bits, 100)
    ready = 100 + network.V3_RESET_TICKS
    for tick, value in ((100, 0), (ready - 1, 0), (ready, 0x80), (100 + network.LINK_TICKS, 0xA0)):
        ports = status(board, tick)
        assert [ports >> 8 * port & 0xFF for port in (0, 1)] == [value if port in down else 0xA0 for port in (0, 1)]
    assert [board.read(0x41A1 + 0x100 * port, 0) >> 16 for port in (0, 1)] == [1 + (port in down) for port in (0, 1)]


def test_v3_reset_sets_its_chip_up_anew_unless_it_is_in_reset() -> None:
    board = v3()
    for tick in (0, 10):
        board.write(0x41A0, 0x5002_0000 | 1 << 23 | 18 << 18 | 7, tick * MS)
        board.write(reg.ETHERNET, 1 << 26 | 0x80, (tick + 1) * MS)
        board.write(0x41A0, 0x6000_0000 | 1 << 23 | 18 << 18, (tick + 2) * MS)
        assert board.read(0x41A0, (tick + 3) * MS) & 0xFFFF == (7 if tick else 0x10)
    assert board.read(0x41A1, 0) >> 16 == 2


def test_processor_s_own_ethernet_is_switched_on_rev_9() -> None:
    board, old = v3(), v3(8)
    for each in (board, old):
        each.write(reg.ETHERNET, 1 << 16, 0)
    assert (status(board), status(old)) == (0x40B1_A0A0, 0x40B0_B0B0)
    for each in (board, old):
        each.write(reg.ETHERNET, 1 << 25, 0)
    assert (status(board), status(old)) == (0x40B0_A0A0, 0x40B0_B0B0)
    for each in (board, old):
        each.write(reg.ETHERNET, 1 << 25 | 1 << 16, 0)
    assert (status(board), status(old)) == (0x40B1_A0A0, 0x40B0_B0B0)


# -- blocks ------------------------------------------------------------------------------------------------------------


def block(board: Network, address: int, count: int) -> list[int]:
    return [board.read(address + k, 7) for k in range(count)]


def test_switch_statistics_begin_with_their_name_on_rev_9() -> None:
    board = v3()
    quads = block(board, 0x40A0, 24)
    assert quads[0].to_bytes(4, "little") == b"ESW0"
    assert quads[1:8] == [0xF000_00CF, 0, 0, 0, 0, 0xE000_0064, 0xFF]
    assert quads[8:] == [*[0] * 9, 0xFFFF, *[0] * 6]
    board.write(reg.ETHERNET, 1 << 26 | 0x8000 | 1 << 25, 7)
    assert block(board, 0x40A1, 1) == [0xF000_00C9]
    assert [block(old, 0x40A0, 24) for old in (v3(8), v2(8), v2(7))] == [[0] * 24] * 3


def test_v2_has_a_shorter_form_of_the_statistics() -> None:
    board = v2(9)
    quads = block(board, 0x40A0, 32)
    assert quads == [0x3057_5345, 0x9000_0009, *[0] * 30]
    board.write(reg.ETHERNET, 1 << 26, 7)
    assert board.read(0x40A1, 7) == 0x9000_0008


def test_chips_of_both_v3_ports_are_behind_management_registers() -> None:
    board = v3()
    for port in (1, 2):
        address = 0x40A0 | port << 8
        board.write(address, 0x6000_0000 | 1 << 23 | (1 + port) << 18, 100)
        assert board.read(address, 100 + MDIO_TICKS - 1) == 0
        assert board.read(address, 100 + MDIO_TICKS) == (1 + port) << 16 | (0x001C, 0xC916)[port - 1]
    for other in (v2(8), v2(9)):
        other.write(0x41A0, 0x6000_0000 | 1 << 23 | 2 << 18, 100)
        assert other.read(0x41A0, 9999) == other.read(0x41A1, 9999) == 0
    assert v3(8).read(0x41A1, 0) == 0


def test_released_firmware_says_it_has_no_debug_data() -> None:
    none = int.from_bytes(b"DBG0", "little")
    for board in (v2(7), v2(8), v2(9), v3(8), v3(9)):
        assert block(board, 0x4080, 16) == [none] * 16
    assert block(v2(8), 0x4090, 16) == [none] * 16
    assert block(v3(8), 0x4090, 16) == [none] * 8 + [0] * 8
    assert block(v3(9), 0x4090, 16) == block(v3(9), 0x44A0, 16) == [0] * 16


def test_everything_else_reads_zero_and_swallows_writes() -> None:
    for board in (v2(7), v2(9), v3(8), v3(9)):
        before = [board.read(address, 0) for address in range(0x4000, 0x6000)]
        for address in (0x00, 0x02, 0x4000, 0x40A0, 0x4FFF, 0x5000, 0x5200):
            board.write(address, 0xFFFF_FFFF, 0)
        assert [board.read(address, 0) for address in range(0x4000, 0x6000)] == before
        assert [board.read(address, 0) for address in (0x4000, 0x40C0, 0x4190, 0x5000, 0x5080, 0x50A0)] == [0] * 6
