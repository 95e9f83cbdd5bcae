"""The QLA's PROM through its registers: bytes and blocks, busy times, latch, pages, protection."""

from __future__ import annotations

import pytest

from tests.boards.devices.prom_host import MS, PromHost
from tests.cases import cases
from trocar.procs.boards.devices import flash
from trocar.procs.boards.devices.prom import QlaProm


class QlaPromHost(PromHost):
    """A host of a QLA's PROM."""

    def byte(self, address: int) -> int:
        return self.ask(flash.READ << 24 | address << 8)

    def put(self, address: int, value: int) -> None:
        self.ask(flash.WRITE_ENABLE << 24)
        self.ask(flash.PROGRAM << 24 | address << 8 | value)
        self.tick += 5 * MS


def test_qla_serial_number_is_read_as_bytes_and_as_a_block() -> None:
    host = QlaPromHost(QlaProm("4711-08"))
    assert bytes(host.byte(at) for at in range(13)) == b"QLA 4711-08\0\xff"
    host.ask(0xFE00_0002)
    assert host.page(3) == b"QLA 4711-08\0"
    assert host.prom.result(host.tick) == int.from_bytes(b"-08\0", "big")


def test_qla_commands_take_128_ticks_a_byte() -> None:
    prom = QlaProm("")
    prom.command(0x0300_0000, 0)
    assert [prom.status(tick) for tick in (0, 1, 384, 385, 512, 513, 514, 515)] == [1, 2, 2, 4, 4, 5, 6, 0]
    assert [prom.result(tick) for tick in (514, 515)] == [0, ord("Q")]
    assert prom.read(0, 1, 600) == [ord("Q")]
    prom.command(0xFE00_0003, 1000)
    assert prom.status(1000 + 387 + 4 * 512 - 1) == 6
    assert prom.status(1000 + 387 + 4 * 512) == 0


@cases("sent", ["d8000000", "d80000", "c7", "b9", "ab000000", "9f", "77"])
def test_eeprom_knows_no_commands_of_the_flash(sent: str) -> None:
    chip = flash.Chip(flash.E25AA128)
    chip.load(0, b"data")
    chip.transfer(bytes([flash.WRITE_ENABLE]), 0, 0)
    assert chip.transfer(bytes.fromhex(sent), 1, 1) == b"\xff"
    assert chip.transfer(bytes([flash.READ_STATUS]), 1, 2) == bytes([flash.ENABLED])
    assert chip.transfer(bytes([flash.READ, 0, 0]), 4, 3) == b"data"


@pytest.mark.parametrize("enable", [True, False])
def test_byte_is_written_only_after_write_enable(enable: bool) -> None:
    host = QlaPromHost(QlaProm(""))
    if enable:
        host.ask(flash.WRITE_ENABLE << 24)
    host.ask(0x0201_2355)
    assert host.chip_status() == (flash.BUSY | flash.ENABLED if enable else 0)
    host.tick += 5 * MS
    assert host.byte(0x123) == (0x55 if enable else 0xFF)


def test_eeprom_overwrites_without_erasing() -> None:
    host = QlaPromHost(QlaProm(""))
    host.put(9, 0x00)
    host.put(0x8009, 0xA5)  # the upper two address bits do not count
    assert host.byte(9) == 0xA5
    assert host.byte(0x4009) == 0xA5


def test_block_is_written_from_the_buffer() -> None:
    host = QlaPromHost(QlaProm(""))
    host.prom.write(0, [0x01020304, 0x05060708, 0x090A0B0C], host.tick)
    host.prom.command(flash.WRITE_ENABLE << 24, host.tick)  # without a wait, as the library does it
    host.prom.command(0xFF00_4001, host.tick)
    host.tick += 5 * MS
    host.ask(0xFE00_4002)
    assert host.page(3) == bytes(range(1, 9)) + b"\xff" * 4
    host.prom.write(15, [7, 8], host.tick)
    assert host.prom.read(14, 3, host.tick)[1:] == [7, 8]


def test_block_beyond_the_page_goes_on_at_its_beginning() -> None:
    host = QlaPromHost(QlaProm(""))
    host.prom.write(0, [0x01020304, 0x05060708], host.tick)
    host.ask(flash.WRITE_ENABLE << 24)
    host.ask(0xFF00_7C01)
    host.tick += 5 * MS
    assert [host.byte(at) for at in (0x7C, 0x7F, 0x40, 0x43, 0x80)] == [1, 4, 5, 8, 0xFF]


def test_upper_quarter_of_the_eeprom_can_be_protected() -> None:
    host = QlaPromHost(QlaProm(""))
    host.ask(flash.WRITE_ENABLE << 24)
    host.ask(flash.WRITE_STATUS << 24 | 0xFF_0000 & 0x04_0000)
    host.tick += 5 * MS
    host.put(0x3000, 1)
    host.put(0x2FFF, 2)
    assert [host.byte(at) for at in (0x3000, 0x2FFF)] == [0xFF, 2]
    assert host.ask(0x9F00_0000) == 2  # not a command here: the last result stays
