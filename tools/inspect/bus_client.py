"""A bus from the tools' side: a separate process accesses the boards, and this client sends requests line by line."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

from trocar.procs.fpga import registers
from trocar.procs.fpga.blocks import LAYOUTS
from trocar.procs.machine.paths import ROOT
from trocar.shm.memory.closable import Closable
from trocar.shm.time.clock import pause
from trocar.tools.inspect.watch import document_of
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.systems.cleanup import await_end
from trocar.tools.systems.find import all_up

FAREWELL_S: Final = 3.0
SERVER: Final = ("-m", "trocar.procs.io.bus.bus_server")
FPGA_COMMAND: Final = 0x031F_FF00  # read the page with the serial number; the only one FPGA V3 heeds
QLA_COMMAND: Final = 0xFE00_0003  # read four quadlets from the PROM's start
QUADS: Final = 4
LOOKS: Final = 20
LOOK_S: Final = 0.001
BUSY: Final = 7  # low bits of the state of a PROM's interface
NO_SERIALS: Final = {"fpga_serial": "", "qla_serial": ""}


@dataclass(frozen=True, slots=True)
class FoundBoard:
    """One controller of a bus."""

    board: int
    node: int
    hardware: str
    firmware: int
    fpga: int
    description: int
    is_hub: bool

    @property
    def is_unknown(self) -> bool:
        """Whether its firmware is newer than those that are known."""
        return self.firmware > max(number for number, row in LAYOUTS.items() if not row.is_assumed)

    @property
    def title(self) -> str:
        """Its title for people."""
        return f"board {self.board} ({self.hardware}, firmware Rev {self.firmware}, FPGA V{self.fpga})"


def shared_id(boards: Sequence[FoundBoard]) -> str:
    """Message about boards with the same id: it is undefined which of them would answer."""
    nodes = " and ".join(str(info.node) for info in boards)
    return f"{len(boards)} boards have id {boards[0].board} (nodes {nodes}); set every rotary switch differently"


def serial_of(data: bytes, kind: str) -> str:
    """`FPGA 1234-56` up to the first byte that is not text, without its kind; empty for other content."""
    text = data.split(b"\xff")[0].split(b"\0")[0].decode("ascii", "replace")
    return text.removeprefix(f"{kind} ") if text.startswith(f"{kind} ") else ""


def _emulated_elsewhere(port: str) -> str:
    """Ports of the emulated boards on this machine, for a person who looks for boards at another port."""
    found = [(name, io.port) for name in all_up() if (document := document_of(name)).emulation is not None
             for io in document.ios if io.port not in ("", port)]
    return "".join(f"; emulated boards of system {name}: trocar bus scan {where}" for name, where in found)


class BusClient(Closable):
    """A bus with its boards found; a context manager. Problem describes its error."""

    def __init__(self, port: str) -> None:
        """Find the boards of a port, named as in system files."""
        self.port = port
        command = [sys.executable, *SERVER, port]
        # A session of its own: Ctrl-C is for us, and then its end of the pipe closes.
        self._child = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
                                       start_new_session=True)
        try:
            self._heard()
            self.boards = tuple(FoundBoard(**row) for row in self._asked("discover")["boards"])
        except Problem as error:
            self.close()
            raise Problem(f"{error}{_emulated_elsewhere(port)}") from None
        except BaseException:
            self.close()
            raise

    def board(self, number: int) -> FoundBoard:
        """A board of the bus; Problem names those there are, and boards that share an id."""
        found = [info for info in self.boards if info.board == number]
        if len(found) > 1:
            raise Problem(f"port {self.port}: {shared_id(found)}")
        if found:
            return found[0]
        there = ", ".join(str(info.board) for info in self.boards)
        raise Problem(f"no board {number} on port {self.port}; boards there: {there}")

    def read(self, board: int, address: int) -> int:
        """One register; refreshes no watchdog."""
        return int(self._asked("read", board=board, address=address)["value"])

    def block(self, board: int, address: int, quads: int) -> list[int]:
        """A block read; at address 0 it restarts the board's sample timer."""
        values: list[int] = self._asked("block", board=board, address=address, quads=quads)["values"]
        return values

    def write(self, board: int, address: int, value: int) -> None:
        """One register; every write refreshes the board's watchdog."""
        self._asked("write", board=board, address=address, value=value)

    def serials(self, board: FoundBoard) -> dict[str, str]:
        """Serial numbers of FPGA board and QLA, 1234-56, out of their PROMs; empty where none was ever written.

        Asking writes command registers, which refreshes the watchdog. Boards of unknown firmware are not asked.
        """
        if board.is_unknown:
            return NO_SERIALS
        fpga = self._serial(board, "FPGA", registers.PROM_COMMAND, FPGA_COMMAND, registers.PROM_COMMAND,
                            registers.FPGA_PROM)
        qla = self._serial(board, "QLA", registers.QLA_PROM_COMMAND, QLA_COMMAND, registers.QLA_PROM_STATUS,
                           registers.QLA_PROM_BUFFER) if board.hardware == "QLA1" else ""
        return {"fpga_serial": fpga, "qla_serial": qla}

    def _serial(self, board: FoundBoard, kind: str, at: int, command: int, state: int, buffer: int) -> str:
        self.write(board.board, at, command)
        for _ in range(LOOKS):
            pause(LOOK_S)
            if not self.read(board.board, state) & BUSY:
                break
        else:
            return ""
        quads = self.block(board.board, buffer, QUADS)
        return serial_of(b"".join(quad.to_bytes(4, "big") for quad in quads), kind)

    def driver(self) -> str:
        """The driver of the bus, here or on another machine; empty if there is none: then it is ours while this is
        open.

        If there is none here, the hub is sampled, which restarts its sample timer.
        """
        try:
            self._asked("own")
        except Problem as error:
            return str(error)
        return ""

    def refuse_others(self, what: str) -> None:
        """Problem while another program drives the bus; `what` gives the consequence for the person."""
        driver = self.driver()
        if driver:
            raise Problem(f"{driver} ({what})")

    def _asked(self, what: str, **arguments: int) -> dict[str, Any]:
        assert self._child.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # it has ended: its output is read next
            self._child.stdin.write(json.dumps({"do": what, **arguments}) + "\n")
            self._child.stdin.flush()
        return self._heard()

    def _heard(self) -> dict[str, Any]:
        assert self._child.stdout is not None
        line = self._child.stdout.readline()
        if not line:
            raise Problem(f"port {self.port}: the process that speaks to the boards ended")
        reported: dict[str, Any] = json.loads(line)
        if "misuse" in reported:
            raise Misuse(reported["misuse"])
        if "error" in reported:
            raise Problem(reported["error"])
        return reported

    def close(self) -> None:
        """End the process that speaks to the boards."""
        for pipe in (self._child.stdin, self._child.stdout):
            if pipe is not None:
                with contextlib.suppress(BrokenPipeError):
                    pipe.close()
        await_end(self._child, FAREWELL_S)
