"""Collection of motor currents on one board: a ring of 1024 entries of commanded and measured current of one axis.

Collection begins with a motor command that has its collection bit set and ends with one of the same axis that has not.
Commands are entered as they arrive, measurements whenever the converter has a new one: every 416 ticks, independent of
any access. The caller sets the measured current (`measure`), so between two such calls all entries are known; the
newest 1024 at most are written.

While `collecting` is false a board needs nothing from the caller but `command` for words with the collection bit.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from trocar.procs.fpga import registers as reg

ENTRIES: Final = 1024
MEASURED: Final = 1 << 31  # else commanded
LATE: Final = 1 << 30  # the time stamp has more than its 14 bits
COLLECTING: Final = 1 << 15  # of the status
STAMP_SHIFT: Final = 16
STAMP_MASK: Final = (1 << 14) - 1
CHANNEL_SHIFT: Final = 10
SAMPLE_TICKS: Final = 416  # 104 cycles of the converter's clock of 12.288 MHz
SAMPLE_PHASE: Final = 144  # tick of the first one after power-up
STATUS_OFFSET: Final = 0x800  # from the buffer's address


class Collection:
    """The buffer and its state; channels count from 1 as they do on the wire."""

    def __init__(self, firmware: int, tick: int = 0) -> None:
        """Empty as after power-up at `tick`."""
        self.collecting = False
        self._free_running = firmware >= 9
        self._entries = np.zeros(ENTRIES, dtype=np.int64)
        self._channel = 1
        self._index = 0  # of the newest entry
        self._measured = reg.CURRENT_ZERO
        self._zero = tick - 1  # tick of the last real-time sample: the time stamp counts from there
        self._first = tick + SAMPLE_PHASE
        self._done = tick  # entries are complete up to this tick

    def command(self, channel: int, word: int, tick: int, measured: int = reg.CURRENT_ZERO) -> None:
        """A motor command is written to an axis; `measured` is that axis' current, which holds from `tick` on."""
        self._run(tick)
        collect = bool(word & reg.DAC_COLLECT)
        if collect and not self.collecting:
            self.collecting, self._channel, self._index = True, channel, 0
            self._measured = measured
        elif channel == self._channel:
            self._index = (self._index + collect) % ENTRIES
            self.collecting = collect
        if collect:  # of another axis too: over the newest entry
            self._entries[self._index] = self._stamp(tick) | word & reg.DAC_VALUE_MASK

    def measure(self, value: int, tick: int) -> None:
        """The collected axis' measured current is another from `tick` on; only of interest while `collecting`."""
        self._run(tick)
        self._measured = value

    def sampled(self, tick: int) -> None:
        """The board took a real-time sample: up to Rev 8 the time stamp counts from there."""
        self._run(tick)
        if not self._free_running:
            self._zero = tick

    @property
    def channel(self) -> int:
        """Axis that is or was collected, from 1."""
        return self._channel

    def status(self, tick: int) -> int:
        """Register 0x7800, and bits 31:16 of the fourth quadlet of a real-time block."""
        self._run(tick)
        return (COLLECTING if self.collecting else 0) | self._channel << CHANNEL_SHIFT | self._index

    def read(self, offset: int, count: int, tick: int) -> list[int]:
        """Quadlets from `offset` (address minus 0x7000) on: the buffer, its mirror at 0x400, the status at 0x800."""
        status = self.status(tick)
        return [int(self._entries[at % ENTRIES]) if not at & STATUS_OFFSET else status if at == STATUS_OFFSET else 0
                for at in range(offset, offset + count)]

    def _stamp(self, tick: int) -> int:
        ticks = max(tick - 1 - self._zero, 0) & 0xFFFF_FFFF  # the counter wraps
        return (LATE if ticks > STAMP_MASK else 0) | (ticks & STAMP_MASK) << STAMP_SHIFT

    def _run(self, tick: int) -> None:
        """Enter the measurements up to and including `tick`."""
        first, last = ((at - self._first) // SAMPLE_TICKS for at in (self._done, tick))
        self._done = max(self._done, tick)
        if not self.collecting:
            return
        if last == first:
            return
        # Some hundred a millisecond while it collects: all at once.
        at = self._first + np.arange(max(first, last - ENTRIES) + 1, last + 1, dtype=np.int64) * SAMPLE_TICKS
        ticks = at - 1 - self._zero & 0xFFFF_FFFF
        places = (self._index - at.size + np.arange(1, at.size + 1) + last - first) % ENTRIES
        self._entries[places] = (MEASURED | self._measured | (ticks > STAMP_MASK) * LATE
                                 | (ticks & STAMP_MASK) << STAMP_SHIFT)
        self._index = (self._index + last - first) % ENTRIES
