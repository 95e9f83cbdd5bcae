"""Serial numbers out of the PROMs of a controller. Asking writes command registers, which refreshes the watchdog."""

from __future__ import annotations

from typing import Final

from trocar.procs.fpga import registers
from trocar.shm.time.clock import pause
from trocar.tools.inspect.bus_client import BusClient, FoundBoard

FPGA_COMMAND: Final = 0x031F_FF00  # read the page with the serial number; the only one FPGA V3 heeds
QLA_COMMAND: Final = 0xFE00_0003  # read four quadlets from the PROM's start
QUADS: Final = 4
LOOKS: Final = 20
LOOK_S: Final = 0.001
BUSY: Final = 7  # low bits of the state of a PROM's interface


def of_fpga(desk: BusClient, board: FoundBoard) -> str:
    """Serial number of the FPGA board, 1234-56; empty where none was ever written."""
    return _asked(desk, board, "FPGA", registers.PROM_COMMAND, FPGA_COMMAND, registers.PROM_COMMAND,
                  registers.FPGA_PROM)


def of_qla(desk: BusClient, board: FoundBoard) -> str:
    """Serial number of a QLA; empty where none was ever written, and for other hardware."""
    if board.hardware != "QLA1":
        return ""
    return _asked(desk, board, "QLA", registers.QLA_PROM_COMMAND, QLA_COMMAND, registers.QLA_PROM_STATUS,
                  registers.QLA_PROM_BUFFER)


def _asked(desk: BusClient, board: FoundBoard, kind: str, at: int, command: int, state: int, buffer: int) -> str:
    desk.write(board.board, at, command)
    for _ in range(LOOKS):
        pause(LOOK_S)
        if not desk.read(board.board, state) & BUSY:
            break
    else:
        return ""
    quads = desk.block(board.board, buffer, QUADS)
    return text_of(b"".join(quad.to_bytes(4, "big") for quad in quads), kind)


def text_of(data: bytes, kind: str) -> str:
    """`FPGA 1234-56` up to the first byte that is no text, without its kind; empty for anything else."""
    text = data.split(b"\xff")[0].split(b"\0")[0].decode("ascii", "replace")
    return text.removeprefix(f"{kind} ") if text.startswith(f"{kind} ") else ""
