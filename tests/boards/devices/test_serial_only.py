"""What FPGA V3 has in the place of its PROM."""

from __future__ import annotations

from trocar.procs.boards.devices.prom import SERIAL_COMMAND, SerialOnly


def page(prom: SerialOnly, count: int = 5) -> bytes:
    return b"".join(quad.to_bytes(4, "big") for quad in prom.read(0, count, 0))


def test_serial_number_command_alone_is_answered() -> None:
    prom = SerialOnly("1234-567")
    assert page(prom) == b"\xff" * 20
    prom.command(SERIAL_COMMAND, 0)
    assert (prom.status(0), prom.result(0)) == (0, 64)
    assert page(prom) == b"FPGA 1234-567\xff\xff\xff" + b"\xff" * 4
    assert prom.read(62, 3, 0) == [0xFFFF_FFFF, 0xFFFF_FFFF, int.from_bytes(b"FPGA", "big")]
    for other in (0x031F_FE00, 0x9F00_0000, 0):
        prom.command(SERIAL_COMMAND, 0)
        prom.command(other, 0)
        assert (prom.status(0), prom.result(0)) == (0, 64)
        assert page(prom) == b"\xff" * 20


def test_first_four_quadlets_can_be_written() -> None:
    prom = SerialOnly("1234-567")
    prom.write(2, [int.from_bytes(b"-99\xff", "big"), 5, 6], 0)
    prom.command(SERIAL_COMMAND, 0)
    assert page(prom) == b"FPGA 123-99\xff\0\0\0\x05" + b"\xff" * 4
