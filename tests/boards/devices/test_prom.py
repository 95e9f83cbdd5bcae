"""The FPGA's PROM through its registers, as a host uses it: commands, busy times, latch, pages, sectors."""

from __future__ import annotations

import pytest

from tests.boards.devices.prom_host import MS, PromHost
from trocar.procs.boards.devices import flash
from trocar.procs.boards.devices.prom import FRAME_TICKS, FpgaProm, QlaProm

SERIAL = 0x031F_FF00


class FlashHost(PromHost):
    """A host of an FPGA's PROM."""

    def read(self, address: int, size: int = 256) -> bytes:
        assert self.ask(flash.READ << 24 | address) == 64
        return self.page(64)[:size]

    def program(self, address: int, data: bytes) -> None:
        self.ask(flash.WRITE_ENABLE << 24)
        words = (flash.PROGRAM << 24 | address).to_bytes(4, "big") + data
        self.prom.write(0, [int.from_bytes(words[k : k + 4], "big") for k in range(0, len(words), 4)], self.tick)
        self.tick += MS
        assert self.prom.result(self.tick) == 1 + len(data) // 4

    def erase(self, address: int) -> None:
        self.ask(flash.WRITE_ENABLE << 24)
        self.ask(flash.ERASE_SECTOR << 24 | address)
        self.tick += 700 * MS


# -- FPGA PROM ---------------------------------------------------------------------------------------------------------


def test_identity_is_that_of_an_m25p16() -> None:
    assert FlashHost(FpgaProm("")).ask(0x9F00_0000) == 0x0020_2015


def test_fpga_serial_number_ends_with_ones() -> None:
    assert FlashHost(FpgaProm("1234-56")).read(0x1FFF00, 16) == b"FPGA 1234-56\xff\xff\xff\xff"
    assert FlashHost(FpgaProm("")).read(0xFFFF00,
                                        16) == b"FPGA 0000-00\xff\xff\xff\xff"  # upper address bits do not count


def test_read_takes_83_microseconds_and_shows_its_states() -> None:
    prom = FpgaProm("")
    prom.command(SERIAL, 0)
    assert [prom.status(tick) for tick in (0, 1, 64, 65, 65 + 4095, 65 + 4096, 65 + 4097, 65 + 4098)] == [
        1, 2, 2, 4, 4, 5, 6, 0]
    assert [prom.result(tick) for tick in (0, 4162, 4163)] == [0, 0, 64]


def test_command_during_a_transfer_is_ignored() -> None:
    prom = FpgaProm("")
    prom.command(SERIAL, 0)
    prom.command(0x9F00_0000, 2000)
    assert prom.result(4163) == 64
    prom.command(0x9F00_0000, 4163)
    assert prom.result(4163 + 67) == 0x0020_2015


def test_command_closer_than_a_frame_waits_for_its_turn() -> None:
    prom = FpgaProm("")
    prom.command(flash.WRITE_ENABLE << 24, 100)
    prom.command(flash.READ_STATUS << 24, 100)
    assert [prom.status(tick) for tick in (100, 101, 117, 118, 119, 120, 154)] == [1, 2, 5, 6, 1, 2, 0]
    assert prom.result(154) == flash.ENABLED
    prom.command(SERIAL, 1000)
    prom.command(0x9F00_0000, 1000 + 4163 - FRAME_TICKS - 1)
    assert prom.result(99999) == 64
    prom.command(SERIAL, 100_000)
    prom.command(0x9F00_0000, 100_000 + 4163 - FRAME_TICKS)
    assert prom.result(199_999) == 0x0020_2015


def test_page_is_programmed_only_after_write_enable() -> None:
    host = FlashHost(FpgaProm(""))
    words = [0x0200_1200, 0x11223344]
    host.prom.write(0, words, host.tick)
    host.tick += 10 * MS
    assert host.read(0x1200, 4) == b"\xff" * 4
    host.program(0x1200, b"\x11\x22\x33\x44")
    assert host.read(0x1200, 8) == b"\x11\x22\x33\x44\xff\xff\xff\xff"


def test_latch_is_set_taken_back_and_used_up() -> None:
    host = FlashHost(FpgaProm(""))
    assert host.chip_status() == 0
    host.ask(flash.WRITE_ENABLE << 24)
    assert host.chip_status() == flash.ENABLED
    host.ask(flash.WRITE_DISABLE << 24)
    assert host.chip_status() == 0
    host.program(0, b"1234")
    host.tick += 10 * MS
    assert host.chip_status() == 0


@pytest.mark.parametrize(("early", "status"), [(1, flash.BUSY | flash.ENABLED), (0, 0)])
def test_chip_is_busy_while_it_programs(early: int, status: int) -> None:
    prom = FpgaProm("")
    prom.command(flash.WRITE_ENABLE << 24, 0)
    prom.write(0, [flash.PROGRAM << 24, 0x01020304], 1000)
    assert [prom.status(tick) for tick in (1000, 1001, 1128, 1129, 1130, 1131)] == [1, 3, 3, 5, 6, 0]
    over = 1131 + round(0.64 * MS)
    prom.command(flash.READ_STATUS << 24, over - 35 - early)  # 35 ticks until the chip is deselected
    assert prom.result(over) == status


def test_chip_is_deaf_while_it_programs() -> None:
    prom = FpgaProm("")
    prom.command(flash.WRITE_ENABLE << 24, 10 * MS)
    prom.write(0, [flash.PROGRAM << 24, 0], 11 * MS)
    prom.command(flash.READ << 24, 11 * MS + 500)
    assert prom.read(0, 1, 12 * MS) == [0xFFFF_FFFF]
    prom.command(SERIAL, 13 * MS)
    assert prom.read(0, 1, 14 * MS) == [int.from_bytes(b"FPGA", "big")]


def test_flash_turns_ones_into_zeros_until_erased() -> None:
    host = FlashHost(FpgaProm(""))
    host.program(0x1F_0000, b"\xf0\x0f\xff\x00")
    host.tick += MS
    host.program(0x1F_0000, b"\x3c\x3c\x3c\x3c")
    host.tick += MS
    assert host.read(0x1F_0000, 4) == b"\x30\x0c\x3c\x00"
    host.program(0x1E_FF00, b"keep")
    host.tick += MS
    host.erase(0x1F_1234)
    assert host.read(0x1F_0000, 4) == b"\xff" * 4
    assert host.read(0x1FFF00, 4) == b"\xff" * 4
    assert host.read(0x1E_FF00, 4) == b"keep"


def test_sector_erase_needs_the_latch_and_takes_its_time() -> None:
    host = FlashHost(FpgaProm(""))
    host.ask(flash.ERASE_SECTOR << 24 | 0x1F_0000)
    assert host.chip_status() == 0
    assert host.read(0x1FFF00, 4) == b"FPGA"
    host.ask(flash.WRITE_ENABLE << 24)
    host.ask(flash.ERASE_SECTOR << 24 | 0x1F_0000)
    host.tick += 590 * MS
    assert host.chip_status() == flash.BUSY | flash.ENABLED
    host.tick += 10 * MS
    assert host.chip_status() == 0


def test_bytes_beyond_the_page_go_on_at_its_beginning() -> None:
    host = FlashHost(FpgaProm(""))
    host.program(0x12FC, b"abcdefgh")
    host.tick += MS
    assert host.read(0x12FC, 8) == b"abcd" + b"\xff" * 4
    assert host.read(0x1200, 8) == b"efgh" + b"\xff" * 4


def test_reads_run_over_pages_and_around_the_end() -> None:
    host = FlashHost(FpgaProm("77"))
    host.program(0, b"zero")
    host.tick += MS
    assert host.read(0x1FFF80)[-128:][:4] == b"zero"
    assert host.read(0x1FFE80)[-128:][:7] == b"FPGA 77"


def test_protected_sectors_can_not_be_written() -> None:
    host = FlashHost(FpgaProm(""))
    for written, status in ((0xFF, 0x9C), (0x08, 0x08)):  # at last the upper two sectors
        host.ask(flash.WRITE_ENABLE << 24)
        host.ask(flash.WRITE_STATUS << 24 | written << 16)
        assert host.chip_status() == status | flash.BUSY | flash.ENABLED
        host.tick += 20 * MS
        assert host.chip_status() == status
    host.program(0x1E_0000, b"nono")
    host.tick += MS
    host.program(0x1D_0000, b"yes!")
    host.tick += MS
    host.erase(0x1F_0000)
    host.ask(flash.WRITE_ENABLE << 24)
    host.ask(flash.ERASE_ALL << 24)
    host.tick += 14_000 * MS
    assert [host.read(at, 4) for at in (0x1E_0000, 0x1D_0000, 0x1FFF00)] == [b"\xff" * 4, b"yes!", b"FPGA"]


def test_bulk_erase_empties_all() -> None:
    host = FlashHost(FpgaProm(""))
    for command, wait in ((flash.WRITE_ENABLE, 0), (flash.ERASE_ALL, 12_000)):
        host.ask(command << 24)
        host.tick += wait * MS
    assert host.chip_status() & flash.BUSY
    host.tick += 2_000 * MS
    assert host.read(0x1FFF00, 4) == b"\xff" * 4


def test_sleeping_chip_only_hears_the_wake_up() -> None:
    host = FlashHost(FpgaProm(""))
    host.ask(flash.SLEEP << 24)
    assert host.ask(0x9F00_0000) == 0xFF_FFFF
    assert host.chip_status() == 0xFF
    assert host.ask(flash.WAKE << 24) == 0x14
    assert host.ask(0x9F00_0000) == 0x20_2015


def test_unknown_commands_leave_the_result_alone() -> None:
    host = FlashHost(FpgaProm(""))
    host.ask(0x9F00_0000)
    for word in (0, 0x0200_0000, 0x7700_0000, 0xFF00_0010):
        assert host.ask(word) == 0x20_2015
    host.prom.write(0, [flash.WRITE_ENABLE << 24], host.tick)  # longer than the command is
    host.tick += MS
    assert host.chip_status() == 0
    host.prom.write(5, [1, 2], host.tick)
    host.prom.write(0, [], host.tick)
    assert host.prom.status(host.tick) == 0


def test_whole_page_with_its_command_is_65_quadlets() -> None:
    host = FlashHost(FpgaProm(""))
    data = bytes(range(256))
    host.program(0x4000, data)
    host.tick += MS
    assert host.read(0x4000) == data


@pytest.mark.parametrize("prom", [FpgaProm, QlaProm])
def test_asking_often_changes_nothing(prom: type[FpgaProm] | type[QlaProm]) -> None:
    seldom, often = prom("1"), prom("1")
    for start, word in enumerate((flash.WRITE_ENABLE << 24, 0x0200_4001, SERIAL, flash.READ_STATUS << 24)):
        for tick in range(start * 4200, start * 4200 + 4200, 7):
            often.status(tick)
            often.result(tick)
            often.read(0, 4, tick)
        seldom.command(word, start * 4200 + 4200)
        often.command(word, start * 4200 + 4200)
    for tick in range(16800, 17200):
        assert (seldom.status(tick), seldom.result(tick)) == (often.status(tick), often.result(tick))
