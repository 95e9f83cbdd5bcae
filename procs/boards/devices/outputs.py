"""The digital outputs of one board: plain levels, one-shots and PWM per output, and the waveform table.

Levels are in register polarity: 1 is a low pin. Nothing is stepped: the levels at any tick from the last write on, and
the changes between two such ticks, follow in closed form from the writes. A write at a tick is applied after the
automatic changes up to and including that tick, and is visible from that tick on. A caller that needs every change must
therefore take the `changes` up to a write before the write, and read `levels` after it.

From tick `busy_until` on nothing changes by itself: a board at rest (`busy_until` 0) needs no calls.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from trocar.procs.boards.controllers.lines import NEVER
from trocar.procs.boards.devices.waveform import ENTRIES, LEVELS, VALID, Waveform

PLAY: Final = 1 << 31  # written: the masked outputs play the table; read: some output does
ENTRY_VALID: Final = 1 << 30
MAX_CHANGES: Final = 4096  # of one call to `changes`
EVERY_OUTPUT: Final = 0xFF
_MASK_SHIFT, _EXTRA_SHIFT, _INDEX_SHIFT = 8, 8, 16
_MAX = 0xFFFF  # a 16-bit counter never exceeds it


class Timer:
    """One output without the table: its level is held as long as the control register sets, then toggles.

    The counter exceeds a count of n at tick n + 2; a count of 0 stops it and holds the level indefinitely.
    """

    def __init__(self, longest_holds: bool = True) -> None:
        """Level 0, held."""
        self.control = 0
        self._longest_holds = longest_holds
        self._level = 0
        self._since = 0  # tick at which the counter had the value `_counted`
        self._counted = 0
        self._plan()

    def set(self, level: int, tick: int) -> None:
        """The output is written: the counter restarts."""
        self._level, self._since, self._counted = level, tick, 0
        self._plan()

    def configure(self, control: int, tick: int) -> None:
        """The control register is written: the counter continues, but misses the tick of the write."""
        level, counted = self.level(tick), self._counter(tick)
        self._level, self._counted, self._since = level, counted, max(tick, self._since) + 1
        self.control = control
        self._plan()

    def count(self, tick: int) -> int:
        """Number of level changes of the output by `tick` since its last write."""
        spent = tick - self._first
        if spent < 0:
            return 0
        if self._back == NEVER:
            return 1
        laps, rest = divmod(spent, self._period)
        return 1 + 2 * laps + (rest >= self._back)

    def at(self, number: int) -> int:
        """Tick at which it turns, `number` from 0."""
        return self._first + number // 2 * self._period + number % 2 * self._back

    def level(self, tick: int) -> int:
        """0 or 1."""
        return self._level ^ self.count(tick) & 1

    @property
    def busy_until(self) -> int:
        """From this tick on it does not change by itself."""
        if self._first == NEVER:
            return 0
        return self._first if self._back == NEVER else NEVER

    def _count_of(self, level: int) -> int:
        return self.control >> 16 if level else self.control & 0xFFFF

    def _holds(self, level: int) -> bool:
        count = self._count_of(level)
        return count == 0 or (count == _MAX and self._longest_holds)

    def _plan(self) -> None:
        own, other = self._count_of(self._level), self._count_of(self._level ^ 1)
        rest = own + 2 - self._counted if self._counted <= own else 1
        self._first = NEVER if self._holds(self._level) else self._since + rest
        self._back = NEVER if self._holds(self._level ^ 1) else other + 2
        self._period = own + 2 + self._back

    def _counter(self, tick: int) -> int:
        turned = self.count(tick)
        began, counted = (self.at(turned - 1), 0) if turned else (self._since, self._counted)
        if self._count_of(self._level ^ turned & 1) == 0:
            return counted
        return counted + max(tick - began, 0) & 0xFFFF


@dataclass(frozen=True, slots=True)
class Changes:
    """History of the outputs: levels at `since`, then (tick, levels) of every change after it.

    If there were more changes than one call may return, `since` is later than requested, and `missed` switchings up to
    it (of single outputs, shown or not) are left out.
    """

    since: int
    levels: int
    items: tuple[tuple[int, int], ...]
    missed: int = 0


class BoardOutputs:
    """All digital outputs of a board: 4 of a QLA, 8 of a DQLA."""

    def __init__(self, count: int = 4, *, longest_holds: bool = True, playing_hides_table: bool = True) -> None:
        """As after power-up at tick 0.

        Quirks of the firmware, on by default: a PWM count of 65535 is held indefinitely like 0 (`longest_holds`), and
        while the table is played every read of it returns the active entry (`playing_hides_table`).
        """
        self.extra = 0  # Rev 9 on FPGA V3.1: four more inputs, read beside the outputs
        self.busy_until = 0
        self._every = (1 << count) - 1
        self._timers = tuple(Timer(longest_holds) for _ in range(count))
        self._waveform = Waveform()
        self._written = 0  # tick of the last write
        self._kinematic = 0  # outputs that follow the table
        self._hides = playing_hides_table

    def write(self, value: int, tick: int) -> None:
        """Register 0x06: new levels of the masked outputs; bit 31 has them play the table from its beginning."""
        mask = value >> _MASK_SHIFT & self._every
        for k, timer in enumerate(self._timers):
            if mask >> k & 1:
                timer.set(value >> k & 1, tick)
        if value & PLAY and mask:
            self._kinematic = mask
            self._waveform.play(tick)
        else:
            self._waveform.stop()
        self._foresee(tick)

    def configure(self, output: int, control: int, tick: int) -> None:
        """Control register of an output: high count << 16 | low count."""
        self._timers[output].configure(control & 0xFFFF_FFFF, tick)
        self._foresee(tick)

    def control(self, output: int) -> int:
        """Control register of an output as it was written."""
        return self._timers[output].control

    def write_table(self, index: int, entries: list[int], tick: int) -> None:
        """Write waveform entries; a playback resumes with them."""
        self._waveform.write(index, entries, tick)
        self._foresee(tick)

    def read_table(self, index: int, count: int, tick: int) -> list[int]:
        """Waveform entries from `index` on; the first follows the last."""
        at = self._waveform.where(tick)
        if at is not None and self._hides:
            return [self._waveform.table[at[0]]] * count
        return [self._waveform.table[(index + k) % ENTRIES] for k in range(count)]

    def levels(self, tick: int) -> int:
        """Levels of all outputs, output 1 in bit 0."""
        levels = 0
        for k, timer in enumerate(self._timers):
            levels |= timer.level(tick) << k
        at = self._waveform.where(tick)
        if at is not None and (entry := self._waveform.table[at[0]]) & VALID:
            levels = levels & ~self._kinematic | entry & LEVELS & self._kinematic
        return levels

    @property
    def plays_once(self) -> bool:
        """Whether the only automatic changes of the levels are those of a table that ends."""
        return self._waveform.end < NEVER and all(timer.busy_until < NEVER for timer in self._timers)

    def playing(self, tick: int) -> bool:
        """Whether outputs follow the table (bit 29 of the digital inputs)."""
        return self._waveform.where(tick) is not None

    def read(self, tick: int) -> int:
        """Register 0x06: levels, extra inputs, table index, and whether the table is played."""
        value = self.levels(tick) | (self.extra & 0xF) << _EXTRA_SHIFT
        at = self._waveform.where(tick)
        if at is None:
            return value
        valid = ENTRY_VALID if self._waveform.table[at[0]] & VALID else 0
        return value | at[0] << _INDEX_SHIFT | valid | PLAY

    def changes(self, after: int, until: int, limit: int = MAX_CHANGES, of: int = EVERY_OUTPUT) -> Changes:
        """Every change of the levels in (after, until] since the last write; the newest `limit` at most.

        `of`: consider only these outputs, so that fast PWM on others causes no cost and hides no change.
        """
        sources = self._sources(of)
        ends = [source.count(until) for source in sources]

        def ahead(tick: int) -> int:
            return sum(end - source.count(tick) for end, source in zip(ends, sources, strict=True))

        since = max(after, self._written)
        total = ahead(since)
        if total > limit:
            late = until
            while late - since > 1:
                middle = (since + late) // 2
                since, late = (middle, late) if ahead(middle) > limit else (since, middle)
            since = late
        ticks = {source.at(k) for end, source in zip(ends, sources, strict=True)
                 for k in range(source.count(since), end)}
        items, levels = [], self.levels(since) & of
        last = levels
        for tick in sorted(ticks):
            if (now := self.levels(tick) & of) != last:
                items.append((tick, now))
                last = now
        return Changes(since, levels, tuple(items), total - ahead(since))

    def settled(self, of: int) -> int:
        """From this tick on these outputs do not change by themselves."""
        return max((source.busy_until for source in self._sources(of)), default=0)

    def _sources(self, of: int) -> list[Timer | Waveform]:
        """Sources of changes of these outputs."""
        timers: list[Timer | Waveform] = [timer for k, timer in enumerate(self._timers) if of >> k & 1]
        return [*timers, self._waveform] if self._kinematic & of else timers

    def _foresee(self, tick: int) -> None:
        self._written = tick
        self.busy_until = max(self._waveform.busy_until, *(timer.busy_until for timer in self._timers))
