"""What every host of a PROM does, whichever PROM it is."""

from __future__ import annotations

from trocar.procs.boards.devices import flash
from trocar.procs.boards.devices.prom import FpgaProm, QlaProm

MS = 49152  # ticks


class PromHost:
    """A host that waits long enough after every command for the transfer to end."""

    def __init__(self, prom: FpgaProm | QlaProm) -> None:
        self.prom = prom
        self.tick = 1000

    def ask(self, word: int) -> int:
        self.prom.command(word, self.tick)
        self.tick += MS
        return self.prom.result(self.tick)

    def chip_status(self) -> int:
        return self.ask(flash.READ_STATUS << 24)

    def page(self, count: int) -> bytes:
        return b"".join(quad.to_bytes(4, "big") for quad in self.prom.read(0, count, self.tick))
