"""Encoder counters and velocity words of all axes of a bus, in closed form from the motion within a physics step.

Within a step the position of an axis, in counts, is x(τ) = x0 + v·τ + h·τ² with τ in ticks since the step began; the
counter is ⌊x⌋ plus the offset from the last preload, and an edge is a crossing of a whole number. Edges are not
simulated one by one: the last six before a moment are the six whole numbers behind x, and solving for their times gives
every quarter period. `observe` updates the six newest edges of each axis to a given moment; edges before the step stay
in the queue. An edge belongs to the first tick at or after its crossing.

As in the real firmware an edge counts in the direction of the edge before it: after a reversal the first one still
counts the old way. So the counter is always where the true count was one edge ago, that is ⌊x⌋ plus a number, less 2
while the newest edge went up. Before the first edge after power-up the latched direction is down.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trocar.procs.boards.controllers.edges import (
    BEHIND,
    EDGES,
    INPUTS,
    LAG,
    NOTHING_SEEN,
    RUNNING,
    flag_table,
    state_table,
)
from trocar.procs.boards.controllers.lines import Floats, Ints, Quads
from trocar.procs.document.system import Quirks
from trocar.procs.fpga import registers as reg
from trocar.procs.native import library
from trocar.procs.native.boards_fields import ENCODERS

TICKS_MAX = reg.VELOCITY_TICKS_MASK
PINS_SHOWN = 4  # axes with their lines in the digital input register
COUNT_TICKS = 4  # the filter of the lines lets no two counts follow faster
LONG_AGO = -(1 << 40)  # tick of edges that never happened: older than any counter can count
_NEVER = (LONG_AGO - np.arange(EDGES) * (TICKS_MAX + 1))[:, None]  # a queue without edges
_MIN = 1e-30  # of a speed squared: an axis at rest would never reach an edge

# From ⌊x⌋ to the newest edge, which is there if it went up or one above, and to each older edge; by edges + 6 (column).
_TO_EDGES = np.array([[1.0 + j if key < EDGES else -float(j) for key in range(2 * EDGES + 1)] for j in range(EDGES)])
# Where each edge of the new queue was among the new edges and those of the old queue; by edges + 6 (column).
_SOURCES = np.array([[j if j < abs(n) else EDGES + j - abs(n) for n in range(-EDGES, EDGES + 1)] for j in range(EDGES)])
_PINS = 1 << np.arange(PINS_SHOWN)


class Encoders:
    """The encoder inputs of `boards` boards with `width` axes each.

    Every array is flat over the slots, width · board + axis. `preload` and `pins` are for reading: `pins` (boards,)
    holds bits 27:20 of the digital input register, lines A and B of the first four axes.
    """

    def __init__(self, boards: int, width: int = PINS_SHOWN, quirks: Sequence[Quirks] = (),
                 rows: Quads | None = None, first: int = 0) -> None:
        """All at rest, counters at mid-range, no edge yet; `quirks` board by board, default: all on.

        `rows` (boards, columns): destination of the words, from column `first` on.
        """
        if boards < 1 or width < PINS_SHOWN:
            raise ValueError(f"{boards} boards with {width} axes; allowed: at least one, with at least {PINS_SHOWN}")
        self.boards, self.width = boards, width
        self.slots = n = boards * width
        self.preload = np.full(n, reg.ENCODER_ZERO, dtype=np.int64)
        self.pins: Quads = np.zeros(boards, dtype=np.uint32)
        self.rows: Quads = np.zeros((boards, 5 * width), dtype=np.uint32) if rows is None else rows
        self.columns, self.first = self.rows.shape[1], first
        self.shown = self.rows[:, first : first + 5 * width].reshape(boards, 5, width)
        self.start = 0  # tick the motion counts from
        self._span = 0  # ticks the motion is good for
        self.curve = np.zeros((3, n))
        self.was = np.zeros(n)  # ⌊x⌋ as last observed
        self.offset = self.preload.copy()  # counter minus ⌊x⌋
        self.turned = np.zeros(n, dtype=np.bool_)  # axes that reverse within the step
        self.hidden = np.zeros(n, dtype=np.bool_)  # those with edges that a plain look at ⌊x⌋ does not show
        self._turns: list[float] = []  # turning points of these still ahead
        self.overflow = np.zeros(n, dtype=np.int64)
        self._lap, self._next_lap = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
        self._lap_was = np.zeros(n)  # ⌊x⌋ when the laps were looked at
        self._lap_due = 0  # tick before which no counter can pass its end
        self.state = np.full(n, NOTHING_SEEN, dtype=np.int64)
        self.queue = np.zeros((EDGES, n), dtype=np.int64) + _NEVER  # ticks counted from the first one after `start`
        quirks = tuple(quirks) or (Quirks(),) * boards
        if len(quirks) != boards:
            raise ValueError(f"quirks of {len(quirks)} boards; there are {boards}")
        self.lag = np.repeat([LAG if q.direction_lag else 0 for q in quirks], width).astype(np.int64)
        self._kept = np.repeat([reg.ENCODER_OVERFLOW if q.sticky_overflow else 0 for q in quirks], width)
        self.state_table, self.flag_table = state_table(), flag_table()
        self.states = len(self.state_table)
        self._set_out, self._advance, self._show = library.chosen(ENCODERS, self)

    def place(self, x: Floats) -> None:
        """Take `x` (counts) as the position at power-up: the counters start at mid-range for any arm position.

        Real filters start low, so that there a high line makes an edge at power-up. This is left out: a host that
        relies on a position preloads it.
        """
        self.curve[0] = x
        np.floor(x, out=self.was)
        self._forget(slice(None))

    def power_up(self, board: int) -> None:
        """The FPGA of a board is reconfigured (observe first): counts, edges and overflows are cleared."""
        self._forget(slice(board * self.width, (board + 1) * self.width))

    def _forget(self, slots: slice) -> None:
        self.preload[slots] = reg.ENCODER_ZERO
        self.queue[:, slots] = _NEVER
        self.state[slots] = NOTHING_SEEN
        self.offset[slots] = reg.ENCODER_ZERO - self._counts()[slots]
        self.overflow[slots] = 0
        self._note_laps()

    def _counts(self) -> Ints:
        """⌊x⌋ as whole numbers."""
        return self.was.astype(np.int64)

    def follow(self, tick: int, span: int, curve: Floats) -> None:
        """Begin a new step at `tick`, valid for `span` ticks.

        `curve` (3, axes): x0 in counts, v in counts/tick, h in counts/tick². The old step must have been observed to
        its end.
        """
        if tick >= self._lap_due:
            self._watch_laps(tick)
        self.curve[...] = curve
        shift, self.start, self._span = tick - self.start, tick, span
        self._turns = self._hidden_turns() if self._set_out(shift, span) else []

    def set_out(self, shift: int, span: int) -> int:
        """On a new curve, `shift` ticks after the last one. 1: there are hidden edges behind turning points."""
        self.queue -= shift
        _, v, h = self.curve
        self.turned[...] = (h * (2.0 * span) + v) * v < 0.0  # v changes sign within the step
        self.hidden.fill(False)
        if not self.turned.any():
            return 0
        x0, v, h = self.curve[:, self.turned]
        half_speed = 0.5 * v
        peak, end = np.floor(x0 - half_speed * (half_speed / h)), np.floor((h * span + v) * span + x0)
        begin = np.floor(x0)
        self.hidden[self.turned] = (peak > np.maximum(begin, end)) | (peak < np.minimum(begin, end))
        return int(np.count_nonzero(self.hidden))

    def _hidden_turns(self) -> list[float]:
        _, v, h = self.curve[:, self.hidden]
        return sorted((-0.5 * v / h).tolist())

    def observe(self, tick: int) -> None:
        """Bring the edges up to `tick` (not before the last observation; clipped to the step)."""
        tau = min(max(tick - self.start, 0), self._span)
        while self._turns and self._turns[0] <= tau:
            turn = self._turns.pop(0)
            self._advance(turn)
            if tick >= self._lap_due:
                self._watch_laps(self.start + int(turn))
        self._advance(tau)

    def advance(self, tau: float) -> int:
        """Edges up to `tau` ticks into the step."""
        x0, v, h = self.curve
        now = np.floor((h * tau + v) * tau + x0)
        if (now != self.was).any():
            self._push(now)
        return 0

    def _push(self, now: Floats) -> None:
        """Put the newest edges of every axis that moved, to ⌊x⌋ = `now` (n,), in front of its queue."""
        x0, v, h = self.curve
        moved, half_speed = now - self.was, v * 0.5
        key = np.minimum(np.maximum(moved, -EDGES), EDGES).astype(np.int64) + EDGES
        distance = _TO_EDGES.take(key, 1) + (now - x0)
        # h·τ² + v·τ = distance, solved as distance / (v/2 ± √(v²/4 + h·distance)): + where the axis sets out upwards
        root = np.copysign(np.sqrt(np.maximum(distance * h + half_speed * half_speed, _MIN)), v + h)
        if self.turned.any():
            # Where the axis first ran the other way it is the other solution, (∓√… - v/2) / h: put as a fraction.
            after = np.flatnonzero(self.turned & (v * moved < 0.0))
            distance[:, after] = -(root[:, after] + half_speed[after]) / h[after]
            root[:, after] = 1.0 - half_speed[after]
            root[(root == -half_speed) & self.turned] = 1.0  # the place itself, of an axis that has not moved
        known = np.concatenate(((distance / (root + half_speed)).astype(np.int64), self.queue))
        known.ravel().take(_SOURCES.take(key, 1) * self.slots + np.arange(self.slots), out=self.queue, mode="clip")
        self.state_table.take(self.state + key, out=self.state, mode="clip")
        self.was[...] = now

    def load(self, axes: Ints, values: Ints) -> None:
        """Preload registers of `axes` are written: the counters become `values` at once (observe first)."""
        self._watch_laps(self.start)
        self.preload[axes] = values
        self.offset[axes] = values - (self._counts() - self._lags())[axes]
        self.overflow[axes] &= self._kept[axes]
        self._note_laps()

    def jump(self, axis: int, counts: int) -> None:
        """The counter is wrong by `counts` from now on, as after lost edges."""
        self._watch_laps(self.start)
        self.offset[axis] += counts
        self._note_laps()

    # -- overflow: rare, and looked for only while a counter is near an end --------------------------------------------

    def _lags(self) -> Ints:
        lags: Ints = self.flag_table[BEHIND].take(self.state) & self.lag
        return lags

    def _watch_laps(self, tick: int) -> None:
        """Set overflow bits of counters that passed an end since the last look: at the least once a stretch of motion
        without reversal, so that the way between two looks has no other extremes than its ends.

        With the lag a counter gets to where the true count is now, `_next_lap`, with the next edge, whichever way.
        """
        before, next_before = self._lap.copy(), self._next_lap.copy()
        moved = self.was != self._lap_was
        room = self._note_laps()
        passed = (self._lap != before) | moved & (next_before != before)
        self.overflow[passed] = reg.ENCODER_OVERFLOW
        self._lap_due = tick + COUNT_TICKS * max(room - LAG, 0)

    def _note_laps(self) -> int:
        """Take the laps as they are, passed or not; the fewest counts that any counter is from an end."""
        value = self._counts() + self.offset
        self._next_lap[:] = value - self.lag // 2 >> 24
        value -= self._lags()
        self._lap[:] = value >> 24
        self._lap_was[:] = self.was
        self._lap_due = 0
        value &= reg.ENCODER_MASK
        return int(np.minimum(value, reg.ENCODER_MASK - value).min())

    def words(self, tick: int) -> None:
        """Show the encoder quadlets of every axis as seen at `tick` (observe first), and the pins.

        `shown` (boards, 5, width): position, period, quarter 1, quarter 5 and running.
        """
        if tick >= self._lap_due:
            self._watch_laps(tick)
        self._show(tick - self.start - 1)

    def show(self, now: int) -> int:
        """The words; `now` counts as the queue's ticks do."""
        count, queue = self._counts(), self.queue
        flags = self.flag_table.take(self.state + (count & 3), 1)
        words = np.array((count + self.offset - (flags[BEHIND] & self.lag) & reg.ENCODER_MASK | self.overflow,
                          queue[0] - queue[4] - 4, queue[0] - queue[1] - 1, queue[4] - queue[5] - 1,
                          np.maximum(now - queue[0], 0)))
        spans = words[1:]
        spans[spans > TICKS_MAX] = reg.VELOCITY_OVERFLOW | TICKS_MAX
        words |= flags[: RUNNING + 1]
        self.shown[...] = words.reshape(5, self.boards, self.width).transpose(1, 0, 2)
        self.pins[...] = flags[INPUTS].reshape(self.boards, self.width)[:, :PINS_SHOWN].dot(_PINS)
        return 0
