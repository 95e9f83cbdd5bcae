"""One pair of encoder lines, processed edge by edge: for lines driven by other lines instead of a motor.

Every change of a line comes with its tick; nothing is stepped from tick to tick. The rule is that of the real firmware:
a line must keep a new level for nine samples, and an edge acts eleven ticks after the change.
`trocar.procs.boards.controllers.encoder` does the same, without that delay, for motors' smooth motions.
"""

from __future__ import annotations

from collections import deque
from typing import Final

from trocar.procs.document.system import Quirks
from trocar.procs.fpga import registers as reg

DELAY: Final = 11  # ticks from a change of a line to its effect
TICKS_MAX: Final = reg.VELOCITY_TICKS_MASK
_FIRM: Final = 2  # this many ticks before its effect a change can no longer be undone
_LONG_AGO: Final = -(1 << 40)
_FAITHFUL: Final = Quirks()

# The edge that must precede another one, by direction.
_DOWN, _UP = range(2)
_BEFORE: Final = (
    {reg.EDGE_B_DOWN: reg.EDGE_A_UP, reg.EDGE_A_UP: reg.EDGE_B_UP, reg.EDGE_B_UP: reg.EDGE_A_DOWN,
     reg.EDGE_A_DOWN: reg.EDGE_B_DOWN},
    {reg.EDGE_B_UP: reg.EDGE_A_UP, reg.EDGE_A_DOWN: reg.EDGE_B_UP, reg.EDGE_B_DOWN: reg.EDGE_A_DOWN,
     reg.EDGE_A_UP: reg.EDGE_B_DOWN})
_OPPOSITE: Final = {reg.EDGE_A_UP: reg.EDGE_A_DOWN, reg.EDGE_A_DOWN: reg.EDGE_A_UP, reg.EDGE_B_UP: reg.EDGE_B_DOWN,
                    reg.EDGE_B_DOWN: reg.EDGE_B_UP}

Edge = tuple[int, int, int, int]  # ticks since the edge before (and overflow bit), direction, error, type
_NO_EDGE: Final[Edge] = (TICKS_MAX, _UP, 0, 0)


class Filter:
    """One line: the changes that got through and have not acted yet, as (tick at which they act, level)."""

    def __init__(self, tick: int, level: int) -> None:
        """The filter is low when the firmware starts at `tick`, for any level of the line."""
        self.level = 0
        self.coming: deque[tuple[int, int]] = deque()
        self.change(tick, level)

    def change(self, tick: int, level: int) -> None:
        """The line is at `level` from `tick` on."""
        if level == self.level:
            return
        self.level = level
        if self.coming and tick < self.coming[-1][0] - _FIRM:
            self.coming.pop()  # too short
        else:
            self.coming.append((tick + DELAY, level))


class Quadrature:
    """Lines A and B of one encoder, its velocity words, and any number of counters of it."""

    def __init__(self, tick: int, a: int, b: int, counters: int = 1, quirks: Quirks = _FAITHFUL) -> None:
        """As after power-up at `tick` with the lines as they are: lines that are high make an edge at once."""
        self._lines = (Filter(tick, a), Filter(tick, b))
        self._lag, self._sticky = quirks.direction_lag, quirks.sticky_overflow
        self._a = self._b = 0  # as filtered
        self._direction = _DOWN  # latched by the newest transition
        self._walked = self._lowest = self._highest = 0  # travel of the counters; its range since the last preload
        self._offsets = [reg.ENCODER_ZERO] * counters
        self._overflows = [0] * counters
        self._newest = _LONG_AGO  # tick of the newest edge
        self._queue: deque[Edge] = deque([_NO_EDGE] * 5, maxlen=5)  # newest first
        self._latched: tuple[int, int, int] | None = None  # words that change only with edges

    def change(self, tick: int, a: int, b: int) -> None:
        """Lines are at `a` and `b` from `tick` on."""
        for line, level in zip(self._lines, (a, b), strict=True):
            line.change(tick, level)
        self.observe(tick)

    def observe(self, tick: int) -> None:
        """Process all edges up to `tick`."""
        a, b = (line.coming for line in self._lines)
        while a or b:
            now = min(line[0][0] for line in (a, b) if line)
            if now > tick:
                return
            self._act(now, *(line.popleft()[1] if line and line[0][0] == now else level
                             for line, level in ((a, self._a), (b, self._b))))

    def _act(self, tick: int, a: int, b: int) -> None:
        old_a, old_b = self._a, self._b
        self._a, self._b = a, b
        direction = a ^ old_b
        if (a != old_a) != (b != old_b):
            self._walked += 1 if (self._direction if self._lag else direction) else -1
            self._lowest, self._highest = min(self._lowest, self._walked), max(self._highest, self._walked)
            self._direction = direction
        kind = ((reg.EDGE_A_UP if a else reg.EDGE_A_DOWN) if a != old_a else 0) | (
            (reg.EDGE_B_UP if b else reg.EDGE_B_DOWN) if b != old_b else 0)
        ticks = tick - 1 - self._newest
        self._newest = tick
        self._queue.appendleft((ticks if ticks <= TICKS_MAX else reg.VELOCITY_OVERFLOW | TICKS_MAX, direction,
                                self._is_error(direction, kind), kind))
        self._latched = None

    def _is_error(self, direction: int, kind: int) -> int:
        _, last_direction, _, last = self._queue[0]
        table = _BEFORE[direction] if direction == last_direction else _OPPOSITE
        return int(last not in (0, sum(before for edge, before in table.items() if edge & kind)))

    def load(self, counter: int, value: int) -> None:
        """The preload register of a counter is written (observe first)."""
        for k in range(len(self._offsets)):
            self._overflows[k] = self._overflow(k)
        self._lowest = self._highest = self._walked
        self._offsets[counter] = value - self._walked
        if not self._sticky:
            self._overflows[counter] = 0

    def _overflow(self, counter: int) -> int:
        offset = self._offsets[counter]
        passed = offset + self._lowest < 0 or offset + self._highest > reg.ENCODER_MASK
        return reg.ENCODER_OVERFLOW if passed else self._overflows[counter]

    def position(self, counter: int = 0) -> int:
        """Position word: counter, overflow, and lines A and B as they are, unfiltered."""
        a, b = (line.level for line in self._lines)
        return ((self._offsets[counter] + self._walked & reg.ENCODER_MASK) | self._overflow(counter)
                | a * reg.ENCODER_PIN_A | b * reg.ENCODER_PIN_B)

    def velocity(self, tick: int) -> tuple[int, int, int, int]:
        """Period, quarter 1, quarter 5 and running at `tick` (observe first)."""
        if self._latched is None:
            self._latched = (self._period(), _quarter(self._queue[0]), _quarter(self._queue[4]))
        running = tick - self._newest
        return (*self._latched, (running if running <= TICKS_MAX else reg.VELOCITY_OVERFLOW | TICKS_MAX)
                | self._direction * reg.VELOCITY_DIRECTION)

    def _period(self) -> int:
        four = [self._queue[k] for k in range(4)]
        total = sum(ticks & TICKS_MAX for ticks, *_ in four)
        ways = {direction for _, direction, _, _ in four}
        return ((total if total <= TICKS_MAX else reg.VELOCITY_OVERFLOW | TICKS_MAX)
                | four[0][1] * reg.VELOCITY_DIRECTION
                | (reg.PERIOD_DIRECTION_CHANGED if len(ways) > 1 else 0)
                | (reg.PERIOD_EDGE_ERROR if any(error for _, _, error, _ in four) else 0)
                | (0 if four[3][3] else reg.PERIOD_PARTIAL))


def _quarter(edge: Edge) -> int:
    ticks, direction, _, kind = edge
    return ticks | direction * reg.VELOCITY_DIRECTION | kind << reg.QUARTER_EDGE_SHIFT
