"""Playing the waveform table of a board's digital outputs: which entry is active at any tick, in closed form.

Entries follow each other, each lasts its value + 1 ticks; the first entry that is not valid ends it. A table whose 1024
entries are all valid repeats endlessly.
"""

from __future__ import annotations

from bisect import bisect_right
from itertools import accumulate
from typing import Final

from trocar.procs.boards.controllers.lines import NEVER

ENTRIES: Final = 1024
VALID: Final = 1 << 31
LEVELS: Final = 0xFF
_LENGTH_SHIFT, _LENGTH_MASK = 8, (1 << 23) - 1


class Waveform:
    """The table, and the position of a playback in it."""

    def __init__(self) -> None:
        """An empty table at rest."""
        self.table = [0] * ENTRIES
        self.end = -1  # tick of the entry that is not valid; at rest after it
        self._index = 0  # first entry of the plan
        self._elapsed = 0  # ticks of it that lay before the plan
        self._starts: list[int] = []  # start ticks of the plan's entries, one lap at most
        self._laps_from = NEVER  # a full table: start tick of the second lap
        self._offsets: list[int] = []  # and the starts within a later lap
        self._lap = 1

    def play(self, tick: int) -> None:
        """Start at entry 0."""
        self._plan(tick, 0, 0)

    def stop(self) -> None:
        """Stop the playback."""
        self.end = -1
        self._starts = []
        self._laps_from = NEVER

    def write(self, index: int, entries: list[int], tick: int) -> None:
        """Write entries from `index` on (the first follows the last); a playback resumes with the new ones."""
        at = self.where(tick)
        for k, entry in enumerate(entries):
            self.table[(index + k) % ENTRIES] = entry
        if at is not None:
            self._plan(tick, *at)

    def where(self, tick: int) -> tuple[int, int] | None:
        """Entry that is on and its ticks gone by; at `end` the invalid one; None at rest."""
        if tick > self.end:
            return None
        if tick >= self._laps_from:
            spent = (tick - self._laps_from) % self._lap
            k = bisect_right(self._offsets, spent) - 1
            return (self._index + k) % ENTRIES, spent - self._offsets[k]
        if tick == self.end:
            return (self._index + len(self._starts)) % ENTRIES, 0
        k = bisect_right(self._starts, tick) - 1
        before = self._elapsed if k == 0 else 0
        return (self._index + k) % ENTRIES, tick - self._starts[k] + before

    @property
    def busy_until(self) -> int:
        """From this tick on there is no playback."""
        return 0 if self.end < 0 else min(self.end + 1, NEVER)

    def count(self, tick: int) -> int:
        """Number of entries (including the one that ends the table) started by `tick` since the plan was made."""
        if tick < self._laps_from:
            return bisect_right(self._starts, tick) + (0 <= self.end <= tick)
        laps, spent = divmod(tick - self._laps_from, self._lap)
        return len(self._starts) + laps * ENTRIES + bisect_right(self._offsets, spent)

    def at(self, number: int) -> int:
        """Start tick of entry `number` (from 0, numbered as `count` does)."""
        if number < len(self._starts):
            return self._starts[number]
        if self._laps_from == NEVER:
            return self.end
        laps, k = divmod(number - len(self._starts), ENTRIES)
        return self._laps_from + laps * self._lap + self._offsets[k]

    def _plan(self, tick: int, index: int, elapsed: int) -> None:
        """Plan the entries that follow `elapsed` ticks after entry `index` began, seen at `tick`."""
        self._index, self._elapsed = index, elapsed
        order = self.table[index:] + self.table[:index]
        valid = next((k for k, entry in enumerate(order) if not entry & VALID), ENTRIES)
        lengths = [(entry >> _LENGTH_SHIFT & _LENGTH_MASK) + 1 for entry in order[:valid]]
        lap = list(accumulate(lengths, initial=0))
        if valid:
            # The counter is compared for equality: past the length it continues until it wraps.
            lengths[0] = (lengths[0] - 1 - elapsed) % (_LENGTH_MASK + 1) + 1
        *self._starts, stop = accumulate(lengths, initial=tick)
        if valid < ENTRIES:
            self.end, self._laps_from = stop, NEVER
        else:
            self.end, self._laps_from = NEVER, stop
            *self._offsets, self._lap = lap
