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
    NOW,
    QUEUE,
    RUNNING,
    flag_table,
    push_table,
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

# From ⌊x⌋ to the newest edge, which is there if it went up or one above, and to each older edge; by key (column).
_TO_EDGES = np.array([[1.0 + j if key < EDGES else -float(j) for key in range(2 * EDGES + 1)] for j in range(EDGES)])


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
        self._x0, self._v, self._h = self.curve
        self.was, self._is = np.zeros(n), np.zeros(n)  # ⌊x⌋ as last observed, and now
        self.offset = self.preload.copy()  # counter minus ⌊x⌋
        self.turned = np.zeros(n, dtype=np.bool_)  # axes that reverse within the step
        self.hidden = np.zeros(n, dtype=np.bool_)  # those with edges that a plain look at ⌊x⌋ does not show
        self._turns: list[float] = []  # turning points of these still ahead
        self.overflow = np.zeros(n, dtype=np.int64)
        self._lap, self._next_lap = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
        self._lap_was = np.zeros(n)  # ⌊x⌋ when the laps were looked at
        self._lap_due = 0  # tick before which no counter can pass its end
        self.state = np.full(n, NOTHING_SEEN, dtype=np.int64)
        self._ticks = np.zeros((QUEUE + EDGES, n), dtype=np.int64)  # counted from the first one after `start`
        self._fresh, self._now, self.queue = self._ticks[:EDGES], self._ticks[NOW], self._ticks[QUEUE:]
        self.queue[...] = _NEVER
        quirks = tuple(quirks) or (Quirks(),) * boards
        if len(quirks) != boards:
            raise ValueError(f"quirks of {len(quirks)} boards; there are {boards}")
        self.lag = np.repeat([LAG if q.direction_lag else 0 for q in quirks], width).astype(np.int64)
        self._kept = np.repeat([reg.ENCODER_OVERFLOW if q.sticky_overflow else 0 for q in quirks], width)
        self._constants(n)
        self._scratch(n)
        self._set_out, self._advance, self._show = library.chosen(ENCODERS, self)

    def _constants(self, n: int) -> None:
        """Whole arrays instead of numbers and rows: numpy takes three times as long to stretch one side."""
        self._push_table, self.state_table, self.flag_table = push_table(n), state_table(), flag_table()
        self.states = len(self.state_table)
        self._columns = np.tile(np.arange(n, dtype=np.int64), (EDGES, 1))
        self._least = np.full((EDGES, n), _MIN)
        self._three, self._none, self._edges = (np.full(n, k, dtype=np.int64) for k in (3, 0, EDGES))
        self._half = np.full(n, 0.5)
        self._mask = np.full(n, reg.ENCODER_MASK, dtype=np.int64)
        self._place = np.zeros(self.width, dtype=np.int64)
        self._place[:PINS_SHOWN] = 1 << np.arange(PINS_SHOWN)
        # period = E0 - E4 - 4, quarter 1 = E0 - E1 - 1, quarter 5 = E4 - E5 - 1, running = now - E0
        self._pairs = np.array((0, 0, 4, NOW - QUEUE, 4, 1, 5, 0)) + QUEUE
        self._spent = np.repeat([4, 1, 1, 0], n).reshape(4, n)
        self._longest = np.full((4, n), TICKS_MAX, dtype=np.int64)
        self._too_long = np.full((4, n), reg.VELOCITY_OVERFLOW | TICKS_MAX, dtype=np.int64)

    def _scratch(self, n: int) -> None:
        self._sum, self._moved = np.zeros((2, n))
        self._rows, self._of_step = np.zeros((3, n)), np.zeros((3, EDGES, n))
        self._bend, self._half_speed, self._first_way = self._of_step  # h, v/2, the way it sets out
        self._key, self._count, self._phase = (np.zeros(n, dtype=np.int64) for _ in range(3))
        self._moves = np.zeros((EDGES + 1, n), dtype=np.int64)
        self._where, self._lifted = self._moves[:EDGES], self._moves[EDGES]
        self._pushed = np.zeros((EDGES, n), dtype=np.int64)
        self._square, self._distance, self._root = np.zeros((3, EDGES, n))
        self._pair_ticks = np.zeros((8, n), dtype=np.int64)
        self._late, self._early = self._pair_ticks[:4], self._pair_ticks[4:]
        self._words = np.zeros((5, n), dtype=np.int64)
        self._word, self._spans, self._running = self._words[0], self._words[1:], self._words[RUNNING]
        self._words_by_board = self._words.reshape(5, -1, self.width).transpose(1, 0, 2)
        self._over = np.zeros((4, n), dtype=np.bool_)
        self._flags = np.zeros((7, n), dtype=np.int64)
        self._word_flags, self._lags_shown = self._flags[: RUNNING + 1], self._flags[BEHIND]
        self._input_pins = self._flags[INPUTS].reshape(-1, self.width)
        self._inputs = np.zeros(n // self.width, dtype=np.int64)

    def place(self, x: Floats) -> None:
        """Take `x` (counts) as the position at power-up: the counters start at mid-range for any arm position.

        Real filters start low, so that there a high line makes an edge at power-up. This is left out: a host that
        relies on a position preloads it.
        """
        self._x0[...] = x
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
        self._count[...] = self.was
        return self._count

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
        queue, turned, speed = self.queue, self.turned, self._sum
        self._pushed.fill(shift)
        np.subtract(queue, self._pushed, queue)
        np.multiply(self._h, 2.0 * span, speed)
        np.add(speed, self._v, speed)
        np.multiply(speed, self._v, speed)
        np.less(speed, 0.0, turned)  # v changes sign within the step
        np.multiply(self._v, self._half, self._rows[1])
        np.add(self._v, self._h, self._rows[2])
        self._rows[0] = self._h
        self._of_step[...] = self._rows[:, None]
        np.multiply(self._half_speed, self._half_speed, self._square)
        self.hidden.fill(False)
        if 1 not in turned.tobytes():
            return 0
        x0, v, h = self.curve[:, turned]
        half_speed = 0.5 * v
        peak, end = np.floor(x0 - half_speed * (half_speed / h)), np.floor((h * span + v) * span + x0)
        begin = np.floor(x0)
        self.hidden[turned] = (peak > np.maximum(begin, end)) | (peak < np.minimum(begin, end))
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
        x, time = self._is, self._sum
        time.fill(tau)
        np.multiply(self._h, time, x)
        np.add(x, self._v, x)
        np.multiply(x, time, x)
        np.add(x, self._x0, x)
        np.floor(x, x)
        if x.tobytes() != self.was.tobytes():
            self._push()
        return 0

    def _push(self) -> None:
        """Put the newest edges of every axis that moved in front of its queue."""
        key, distance, root, half_speed = self._key, self._distance, self._root, self._half_speed
        np.subtract(self._is, self.was, self._moved)
        key[...] = self._moved
        np.add(key, self._edges, key)
        self._push_table.take(key, 1, self._moves, "clip")
        np.add(self.state, self._lifted, key)
        self.state_table.take(key, None, self.state, "clip")
        _TO_EDGES.take(self._lifted, 1, distance, "clip")
        np.subtract(self._is, self._x0, self._sum)
        np.add(distance, self._sum, distance)
        # h·τ² + v·τ = distance, solved as distance / (v/2 ± √(v²/4 + h·distance)): + where the axis sets out upwards
        np.multiply(distance, self._bend, root)
        np.add(root, self._square, root)
        np.maximum(root, self._least, out=root)
        np.sqrt(root, root)
        np.copysign(root, self._first_way, root)
        if 1 in self.turned.tobytes():
            self._solve_after_turn(distance, root)
        np.add(root, half_speed, root)
        np.divide(distance, root, distance)
        self._fresh[...] = distance
        np.add(self._where, self._columns, self._where)
        self._ticks.take(self._where, None, self._pushed, "clip")
        self.queue[...] = self._pushed
        self.was[...] = self._is

    def _solve_after_turn(self, distance: Floats, root: Floats) -> None:
        """Where the axis first ran the other way it is the other solution, (∓√… - v/2) / h: put as a fraction."""
        after = np.flatnonzero(self.turned & (self._v * self._moved < 0.0))
        if after.size:
            half_speed = self._half_speed[:, after]
            distance[:, after] = -(root[:, after] + half_speed) / self._h[after]
            root[:, after] = 1.0 - half_speed
        # the place itself, of an axis that has not moved
        np.putmask(root, (root == -self._half_speed) & self.turned, 1.0)

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
        spans, running = self._spans, self._running
        self._now.fill(now)
        self._show_counts()
        self._ticks.take(self._pairs, 0, self._pair_ticks, "clip")
        np.subtract(self._late, self._early, spans)
        np.subtract(spans, self._spent, spans)
        np.maximum(running, self._none, out=running)
        np.greater(spans, self._longest, self._over)
        if 1 in self._over.tobytes():
            np.putmask(spans, self._over, self._too_long)
        np.bitwise_or(self._words, self._word_flags, self._words)
        self.shown[...] = self._words_by_board
        return 0

    def _show_counts(self) -> None:
        """Counters, flags and pins."""
        count, word, phase, lags = self._counts(), self._word, self._phase, self._lags_shown
        np.bitwise_and(count, self._three, phase)
        np.add(self.state, phase, phase)
        self.flag_table.take(phase, 1, self._flags, "clip")
        np.bitwise_and(lags, self.lag, lags)
        np.add(count, self.offset, word)
        np.subtract(word, lags, word)
        np.bitwise_and(word, self._mask, word)
        np.bitwise_or(word, self.overflow, word)
        self._input_pins.dot(self._place, self._inputs)
        self.pins[...] = self._inputs
