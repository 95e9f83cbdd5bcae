"""Emulated controllers of any kind behind a socket, for tests of the host's side; they move nothing."""

from __future__ import annotations

import select
import socket
import threading
import time

from tests.fpga import board_side
from tests.io.stub_bus import own_address
from trocar.procs.boards.controllers.bus import EmulatedBus
from trocar.procs.document.system import Controller
from trocar.procs.fpga import wire

TICKS_PER_NS = 49.152e-3


def controller(board: int, hardware: str = "QLA1", firmware: int = 8) -> Controller:
    return Controller(board, hardware, firmware, "V2" if hardware == "QLA1" and firmware < 9 else "V3")


class ControllersBus:
    """A thread that answers for a bus of controllers, on a clock that follows the wall's."""

    def __init__(self, *controllers: Controller, port: int = 0) -> None:
        self.bus = EmulatedBus(controllers)
        self.ids = sorted(c.board_id for c in controllers)
        self.address = own_address()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((self.address, port))
        self.port = self._socket.getsockname()[1]
        self.groups: list[board_side.WriteGroup] = []
        self._start_ns = time.monotonic_ns()
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)

    def __enter__(self) -> ControllersBus:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._socket.close()

    def _serve(self) -> None:
        while not self._stop.is_set():
            if select.select([self._socket], (), (), 0.02)[0]:
                data, sender = self._socket.recvfrom(4096)
                request = board_side.decode_request(data)
                if request.tcode == wire.BLOCK_WRITE:
                    self.groups += board_side.decode_write(request.data, 8)
                reply = self.bus.answer(data, round((time.monotonic_ns() - self._start_ns) * TICKS_PER_NS))
                if reply:
                    self._socket.sendto(bytes(reply), sender)
