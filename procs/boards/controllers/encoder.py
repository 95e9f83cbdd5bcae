"""Encoder counters and velocity words of all axes of a bus, in closed form from the motion within a physics step.

Within a step the position of an axis, in counts, is x(τ) = x0 + v·τ + h·τ² with τ in ticks since the step began; the
counter is ⌊x⌋ plus what the last preload made of it, and an edge is a crossing of a whole number. Edges are not
simulated one by one: the last six before a moment are the six whole numbers behind x, and solving for their times
gives every quarter period. `observe` brings the six newest edges of each axis up to a moment; what came before the
step stays in the queue. An edge belongs to the first tick at or after its crossing.

As in the real firmware an edge counts in the direction of the edge before it: after a reversal the first one still
counts the old way. So the counter is always where the true count was one edge ago, that is ⌊x⌋ plus a number, less 2
while the newest edge went up. Before the first edge after power-up the latched direction is down.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from procs.boards.controllers.edges import (
    BEHIND,
    EDGES,
    INPUTS,
    LAG,
    NOTHING_SEEN,
    NOW,
    POSITION,
    QUEUE,
    RUNNING,
    Ints,
    flag_table,
    push_table,
    state_table,
)
from procs.lib import registers as reg
from procs.lib.document import Quirks

Floats = npt.NDArray[np.float64]
Quads = npt.NDArray[np.uint32]

TICKS_MAX = reg.VELOCITY_TICKS_MASK
PINS_SHOWN = 4  # axes whose lines are in the digital input register
COUNT_TICKS = 4  # the filter of the lines lets no two counts follow faster
LONG_AGO = -(1 << 40)  # tick of edges that never were: older than any counter can tell
_NEVER = (LONG_AGO - np.arange(EDGES) * (TICKS_MAX + 1))[:, None]  # a queue without edges


class Encoders:
    """The encoder inputs of `boards` boards with `width` axes each.

    Every array is flat over the slots, width · board + axis. `preload` and `pins` are for reading: `pins` (boards,)
    holds bits 27:20 of the digital input register, lines A and B of the first four axes.
    """

    def __init__(self, boards: int, width: int = PINS_SHOWN, quirks: Sequence[Quirks] = ()) -> None:
        """All at rest, counters at mid-range, no edge yet; `quirks` board by board, all on where none are given."""
        if boards < 1 or width < PINS_SHOWN:
            raise ValueError(f"{boards} boards with {width} axes; allowed: at least one, with at least {PINS_SHOWN}")
        self.width = width
        n = boards * width
        self.preload = np.full(n, reg.ENCODER_ZERO, dtype=np.int64)
        self.pins: Quads = np.zeros(boards, dtype=np.uint32)
        self.start = 0  # tick the motion counts from
        self._span = 0.0  # ticks the motion is good for
        self._x0, self._v = np.zeros(n), np.zeros(n)
        self._rates = np.zeros((3, n))  # what changes sign with the direction: way since x0 - ½, h, v/2
        self._way, self._h, self._half_v = self._rates
        self._whole = np.zeros(n)  # ⌊x⌋ when last observed
        self._whole_bytes = self._whole.tobytes()
        self._offset = self.preload.copy()  # counter minus ⌊x⌋
        self._turning = False  # some axis turns round within the step
        self._turns: list[float] = []  # turning points still ahead that hide edges from a plain look at ⌊x⌋
        self._stale = True  # the words do not yet show the newest counts and edges
        self._overflow = np.zeros(n, dtype=np.int64)
        self._lap, self._next_lap = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
        self._lap_whole = np.zeros(n)  # ⌊x⌋ when the laps were looked at
        self._lap_due = 0  # tick before which no counter can pass its end
        self._state = np.full(n, NOTHING_SEEN, dtype=np.int64)
        # Two pools take turns: one gather moves the queue from one to the other.
        self._pool = np.zeros((QUEUE + EDGES, n), dtype=np.int64)
        self._spare = np.zeros_like(self._pool)
        self._pool[QUEUE:] = _NEVER
        self._constants(n)
        self._scratch(n)
        quirks = tuple(quirks) or (Quirks(),) * boards
        if len(quirks) != boards:
            raise ValueError(f"quirks of {len(quirks)} boards; there are {boards}")
        self._lag = np.repeat([LAG if q.direction_lag else 0 for q in quirks], width).astype(np.int64)
        self._kept = np.repeat([reg.ENCODER_OVERFLOW if q.sticky_overflow else 0 for q in quirks], width)
        self._all_lag = bool(self._lag.all())

    def _constants(self, n: int) -> None:
        """Whole arrays instead of numbers and rows: numpy takes three times as long to stretch one side."""
        self._push_table, self._state_table, self._flag_table = push_table(n), state_table(), flag_table()
        self._columns = np.tile(np.arange(n, dtype=np.int64), (EDGES, 1))
        self._steps = np.tile(np.arange(EDGES)[:, None] + 0.5, (1, n))
        self._no_less, self._zero = np.full((EDGES, n), 1e-15), np.zeros((EDGES, n))
        self._half, self._six = np.full(n, 0.5), np.full(n, float(EDGES))
        self._three, self._none = (np.full(n, k, dtype=np.int64) for k in (3, 0))
        self._mask = np.full(n, reg.ENCODER_MASK, dtype=np.int64)
        self._stretch, self._thrice = np.repeat(np.arange(4), EDGES), np.zeros(3, dtype=np.intp)
        self._place = np.zeros(self.width, dtype=np.int64)
        self._place[:PINS_SHOWN] = 1 << np.arange(PINS_SHOWN)
        # period = E0 - E4 - 4, quarter 1 = E0 - E1 - 1, quarter 5 = E4 - E5 - 1, running = now - E0
        self._pairs = np.array((0, 0, 4, NOW - QUEUE, 4, 1, 5, 0)) + QUEUE
        self._spent = np.repeat([4, 1, 1, 0], n).reshape(4, n)
        self._longest = np.full((4, n), TICKS_MAX, dtype=np.int64)
        self._too_long = np.full((4, n), reg.VELOCITY_OVERFLOW | TICKS_MAX, dtype=np.int64)

    def _scratch(self, n: int) -> None:
        self._x, self._moved, self._sign, self._x_half = (np.zeros(n) for _ in range(4))
        self._key, self._count, self._word, self._phase = (np.zeros(n, dtype=np.int64) for _ in range(4))
        self._word_by_board = self._word.reshape(-1, self.width)
        self._rows = np.zeros((EDGES + 1, n), dtype=np.int64)
        self._where, self._lifted = self._rows[:EDGES], self._rows[EDGES]
        self._motion = np.zeros((4, n))  # rates in the direction of motion, and v²/4
        self._forward, self._square = self._motion[:3], self._motion[3]
        self._sign_row, self._signs = self._sign.reshape(1, n), np.zeros((3, n))
        self._stretched = np.zeros((4 * EDGES, n))
        self._blocks = tuple(self._stretched.reshape(4, EDGES, n))
        self._first, self._tau = np.zeros((EDGES, n), dtype=np.int64), np.zeros(n)
        self._pair_ticks = np.zeros((8, n), dtype=np.int64)
        self._spans, self._before = self._pair_ticks[:4], self._pair_ticks[4:]
        self._spans_by_board = self._spans.reshape(4, -1, self.width).transpose(1, 0, 2)
        self._over = np.zeros((4, n), dtype=np.bool_)
        self._flags = np.zeros((7, n), dtype=np.int64)
        self._input_pins = self._flags[INPUTS].reshape(-1, self.width)
        self._inputs = np.zeros(n // self.width, dtype=np.int64)
        self._turned = np.zeros(n, dtype=np.bool_)
        self._when, self._peak, self._end, self._bound = (np.zeros(n) for _ in range(4))

    def place(self, x: Floats) -> None:
        """Take `x` (counts) as the position at power-up: the counters start at mid-range wherever the arm is.

        Real filters start low, so that there a line that is high makes an edge at power-up. Left out: whoever counts
        on a position preloads it.
        """
        self._x0[:] = x
        np.floor(x, out=self._whole)
        self._whole_bytes = self._whole.tobytes()
        self._forget(slice(None))

    def power_up(self, board: int) -> None:
        """The FPGA of a board is configured anew (observe first): nothing is left of counts, edges and overflows."""
        self._forget(slice(board * self.width, (board + 1) * self.width))

    def _forget(self, slots: slice) -> None:
        self.preload[slots] = reg.ENCODER_ZERO
        self._pool[QUEUE:, slots] = _NEVER
        self._state[slots] = NOTHING_SEEN
        self._offset[slots] = reg.ENCODER_ZERO - self._counts()[slots]
        self._overflow[slots] = 0
        self._note_laps()

    def _counts(self) -> Ints:
        """⌊x⌋ as whole numbers."""
        np.copyto(self._count, self._whole, casting="unsafe")
        return self._count

    def follow(self, tick: int, span: int, x0: Floats, v: Floats, h: Floats) -> None:
        """A new step begins at `tick`, good for `span` ticks: x0 in counts, v in counts/tick, h in counts/tick².

        The old step must have been observed to its end. x0 and v are kept as they are, not copied: they must not change
        within the step.
        """
        if tick >= self._lap_due:
            self._watch_laps(tick)
        self.start, self._span = tick, float(span)
        self._x0, self._v = x0, v
        self._h[:] = h
        self._first.fill(tick + 1)
        np.multiply(v, self._half, self._half_v)
        np.multiply(self._half_v, self._half_v, self._square)
        np.subtract(x0, self._half, self._x_half)
        # v changes sign within the step: v · (v + 2·h·span) < 0
        sign = self._sign
        self._tau.fill(2.0 * span)
        np.multiply(h, self._tau, sign)
        np.add(sign, v, sign)
        np.multiply(sign, v, sign)
        np.less(sign, self._zero[0], self._turned)
        self._turning = bool(np.count_nonzero(self._turned))
        self._turns = self._find_turns() if self._turning else []

    def _find_turns(self) -> list[float]:
        """Turning points beyond which edges were crossed that lie outside the way from start to end."""
        when, peak, end, bound, work = self._when, self._peak, self._end, self._bound, self._sign
        when.fill(0.0)
        np.divide(self._half_v, self._h, out=when, where=self._turned)  # up to its sign
        np.multiply(self._half_v, when, peak)
        np.subtract(self._x0, peak, peak)
        np.floor(peak, peak)
        np.multiply(self._h, self._span, end)
        np.add(end, self._v, end)
        np.multiply(end, self._span, end)
        np.add(end, self._x0, end)
        np.floor(end, end)
        np.floor(self._x0, work)
        beyond = np.greater(peak, np.maximum(work, end, out=bound))
        beyond |= np.less(peak, np.minimum(work, end, out=bound))
        return sorted(-t for t in when[beyond].tolist()) if np.count_nonzero(beyond) else []

    def observe(self, tick: int) -> None:
        """Bring the edges up to `tick` (not before the last observation; clipped to the step)."""
        tau = min(max(float(tick - self.start), 0.0), self._span)
        while self._turns and self._turns[0] <= tau:
            turn = self._turns.pop(0)
            self._advance(turn)
            if tick >= self._lap_due:
                self._watch_laps(self.start + int(turn))
        self._advance(tau)

    def _advance(self, tau: float) -> None:
        x = self._x
        taus = self._tau
        taus.fill(tau)
        np.multiply(self._h, taus, x)
        np.add(x, self._v, x)
        np.multiply(x, taus, x)
        np.add(x, self._x0, x)
        np.floor(x, x)
        whole = x.tobytes()
        if whole != self._whole_bytes:
            self._whole_bytes = whole
            self._push()

    def _push(self) -> None:
        """Put the newest edges of every axis that moved in front of its queue."""
        x, moved, sign, key = self._x, self._moved, self._sign, self._key
        np.subtract(x, self._whole, moved)
        self._whole, self._x = x, self._whole
        np.add(moved, self._six, sign)
        np.copyto(key, sign, casting="unsafe")
        self._push_table.take(key, 1, self._rows, "clip")
        np.add(self._state, self._lifted, key)
        self._state_table.take(key, None, self._state, "clip")
        # In the direction of motion s: distance of the newest edge from x0, then one count less for each older edge
        # (upwards the newest edge is ⌊x⌋, downwards ⌊x⌋ + 1).
        np.sign(moved, sign)
        np.subtract(x, self._x_half, self._way)
        self._sign_row.take(self._thrice, 0, self._signs, "clip")
        np.multiply(self._rates, self._signs, self._forward)
        self._motion.take(self._stretch, 0, self._stretched, "clip")
        wide, root, half_speed, square = self._blocks
        np.subtract(wide, self._steps, wide)
        # h'·τ² + w·τ = distance, solved as distance / (w/2 + √(w²/4 + h'·distance))
        np.multiply(root, wide, root)
        np.add(root, square, root)
        np.maximum(root, self._zero, out=root)
        np.sqrt(root, root)
        if self._turning:
            self._solve_after_turn(wide, root, half_speed)
        np.add(root, half_speed, root)
        np.maximum(root, self._no_less, out=root)
        np.divide(wide, root, wide)
        pool, spare = self._pool, self._spare
        fresh = pool[:EDGES]
        np.copyto(fresh, wide, casting="unsafe")
        np.add(fresh, self._first, fresh)
        np.add(self._where, self._columns, self._where)
        pool.take(self._where, None, spare[QUEUE:], "clip")
        self._pool, self._spare = spare, pool
        self._stale = True

    def _solve_after_turn(self, wide: Floats, root: Floats, half_speed: Floats) -> None:
        """Where the axis first ran the other way (w < 0) the root is (√… − w/2) / h': put it as distance over root."""
        np.less(half_speed[0], self._zero[0], self._turned)
        after = np.flatnonzero(np.logical_and(self._turned, self._moved, self._turned))
        if after.size:
            wide[:, after] = (root[:, after] - half_speed[:, after]) / self._forward[1, after]
            root[:, after] = 1.0 - half_speed[:, after]

    def load(self, axes: Ints, values: Ints) -> None:
        """Preload registers of `axes` are written: the counters become `values` at once (observe first)."""
        self._watch_laps(self.start)
        self.preload[axes] = values
        self._offset[axes] = values - (self._counts() - self._lags())[axes]
        self._overflow[axes] &= self._kept[axes]
        self._note_laps()

    def jump(self, axis: int, counts: int) -> None:
        """The counter is wrong by `counts` from now on, as after lost edges."""
        self._watch_laps(self.start)
        self._offset[axis] += counts
        self._note_laps()

    # -- overflow: rare, and looked for only while a counter is near an end --------------------------------------------

    def _lags(self) -> Ints:
        lags: Ints = self._flag_table[BEHIND].take(self._state) & self._lag
        return lags

    def _watch_laps(self, tick: int) -> None:
        """Set overflow bits of counters that passed an end since the last look: at the least once a stretch of motion
        without reversal, so that the way between two looks has no other extremes than its ends.

        With the lag a counter gets to where the true count is now, `_next_lap`, with the next edge, whichever way.
        """
        before, next_before = self._lap.copy(), self._next_lap.copy()
        moved = self._whole != self._lap_whole
        room = self._note_laps()
        passed = (self._lap != before) | moved & (next_before != before)
        self._overflow[passed] = reg.ENCODER_OVERFLOW
        self._lap_due = tick + COUNT_TICKS * max(room - LAG, 0)

    def _note_laps(self) -> int:
        """Take the laps as they are, passed or not; the fewest counts that any counter is from an end."""
        value = self._counts() + self._offset
        self._next_lap[:] = value - self._lag // 2 >> 24
        value -= self._lags()
        self._lap[:] = value >> 24
        self._lap_whole[:] = self._whole
        self._lap_due, self._stale = 0, True
        value &= reg.ENCODER_MASK
        return int(np.minimum(value, reg.ENCODER_MASK - value).min())

    def words(self, tick: int, position: Quads, velocity: Quads) -> None:
        """Write the encoder quadlets of every axis as seen at `tick` (observe first).

        `position` is (boards, width), `velocity` (boards, 4, width): period, quarter 1, quarter 5 and running.
        """
        pool, spans = self._pool, self._spans
        pool[NOW].fill(tick)
        if self._stale:
            if tick >= self._lap_due:
                self._watch_laps(tick)
            self._stale = False
            self._show_counts()
            pool.take(self._pairs, 0, self._pair_ticks, "clip")
            np.subtract(spans, self._before, spans)
            np.subtract(spans, self._spent, spans)
            np.maximum(spans[3], self._none, out=spans[3])
            np.greater(spans, self._longest, self._over)
            np.putmask(spans, self._over, self._too_long)
            np.bitwise_or(spans, self._flags[:4], spans)
        else:  # only the running counters go on
            running = spans[3]
            np.subtract(pool[NOW], pool[QUEUE], running)
            np.maximum(running, self._none, out=running)
            np.greater(running, self._longest[3], self._over[3])
            np.putmask(running, self._over[3], self._too_long[3])
            np.bitwise_or(running, self._flags[RUNNING], running)
        position[...] = self._word_by_board
        velocity[...] = self._spans_by_board

    def _show_counts(self) -> None:
        """Position words, flags and pins after a change."""
        count, word, phase, flags = self._counts(), self._word, self._phase, self._flags
        np.bitwise_and(count, self._three, phase)
        np.add(self._state, phase, phase)
        self._flag_table.take(phase, 1, flags, "clip")
        if not self._all_lag:
            np.bitwise_and(flags[BEHIND], self._lag, flags[BEHIND])
        np.add(count, self._offset, word)
        np.subtract(word, flags[BEHIND], word)
        np.bitwise_and(word, self._mask, word)
        np.bitwise_or(word, self._overflow, word)
        np.bitwise_or(word, flags[POSITION], word)
        self._input_pins.dot(self._place, self._inputs)
        np.copyto(self.pins, self._inputs, casting="unsafe")
