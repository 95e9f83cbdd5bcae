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
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from procs.boards.controllers.edges import (
    BEHIND,
    EDGES,
    INPUTS,
    LAG,
    NOTHING_SEEN,
    NOW,
    QUEUE,
    RUNNING,
    Ints,
    flag_table,
    push_table,
    state_table,
)
from procs.document.system import Quirks
from procs.fpga import registers as reg

Floats = npt.NDArray[np.float64]
Quads = npt.NDArray[np.uint32]

TICKS_MAX = reg.VELOCITY_TICKS_MASK
PINS_SHOWN = 4  # axes whose lines are in the digital input register
COUNT_TICKS = 4  # the filter of the lines lets no two counts follow faster
LONG_AGO = -(1 << 40)  # tick of edges that never were: older than any counter can tell
_NEVER = (LONG_AGO - np.arange(EDGES) * (TICKS_MAX + 1))[:, None]  # a queue without edges
_MIN = 1e-30  # of a speed squared: what stands still would reach nothing

# Rows that sums are made of, several at once by a small matrix product: it costs no more than one addition.
_X0, _V, _H, _ONE, _WAS, _IS, _WAY = range(7)
_TO_KEY = np.array((0.0, 0.0, 0.0, EDGES, -1.0, 1.0, 0.0))  # ⌊x⌋ - ⌊x⌋ as last observed + 6
_WAYS = np.sign(np.arange(-EDGES, EDGES + 1.0))  # by key: down, not moved, up
# From x0 to the newest edge, ⌊x⌋ if it went up or ⌊x⌋ + 1, and one count less or more for each older edge.
_TO_EDGES = np.array([(-1.0, 0.0, 0.0, 0.5, 0.0, 1.0, -0.5 - j) for j in range(EDGES)])


@dataclass(frozen=True, slots=True)
class _Pool:
    """Ticks of edges, newest first, and parts of them."""

    ticks: Ints
    fresh: Ints
    now: Ints
    queue: Ints

    @classmethod
    def of(cls, axes: int) -> _Pool:
        ticks = np.zeros((QUEUE + EDGES, axes), dtype=np.int64)
        return cls(ticks, ticks[:EDGES], ticks[NOW], ticks[QUEUE:])


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
        self._span = 0  # ticks the motion is good for
        self._terms = np.zeros((len(_TO_KEY), n))
        self._terms[_ONE] = 1.0
        self._curve = self._terms[: _H + 1]
        self._x0, self._v, self._h = self._curve
        self._was, self._is, self._way = self._terms[_WAS], self._terms[_IS], self._terms[_WAY]
        self._was_bytes = self._was.tobytes()
        self._offset = self.preload.copy()  # counter minus ⌊x⌋
        self._turning = False  # some axis turns round within the step
        self._turns: list[float] = []  # turning points still ahead that hide edges from a plain look at ⌊x⌋
        self._stale = True  # the words do not yet show the newest counts and edges
        self._overflow = np.zeros(n, dtype=np.int64)
        self._lap, self._next_lap = np.zeros(n, dtype=np.int64), np.zeros(n, dtype=np.int64)
        self._lap_was = np.zeros(n)  # ⌊x⌋ when the laps were looked at
        self._lap_due = 0  # tick before which no counter can pass its end
        self._state = np.full(n, NOTHING_SEEN, dtype=np.int64)
        # Two pools take turns: one gather moves the queue from one to the other. Their ticks count from the first one
        # after `start`.
        self._pool, self._spare = _Pool.of(n), _Pool.of(n)
        self._pool.queue[...] = _NEVER
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
        self._least = np.full((EDGES, n), _MIN)
        self._three, self._none = (np.full(n, k, dtype=np.int64) for k in (3, 0))
        self._nothing = np.zeros(n)
        self._mask = np.full(n, reg.ENCODER_MASK, dtype=np.int64)
        self._place = np.zeros(self.width, dtype=np.int64)
        self._place[:PINS_SHOWN] = 1 << np.arange(PINS_SHOWN)
        self._powers = np.ones(3)  # of τ
        self._to_step = np.zeros((3 * EDGES + 1, 3))  # from the curve to what of it is needed all through a step
        for first, of in ((0, (0.0, 0.0, 1.0)), (EDGES, (0.0, 0.5, 0.0)), (2 * EDGES, (0.0, 1.0, 1.0))):
            self._to_step[first : first + EDGES] = of
        self._to_step[-1, _V] = 1.0
        # period = E0 - E4 - 4, quarter 1 = E0 - E1 - 1, quarter 5 = E4 - E5 - 1, running = now - E0
        self._pairs = np.array((0, 0, 4, NOW - QUEUE, 4, 1, 5, 0)) + QUEUE
        self._spent = np.repeat([4, 1, 1, 0], n).reshape(4, n)
        self._longest = np.full((4, n), TICKS_MAX, dtype=np.int64)
        self._too_long = np.full((4, n), reg.VELOCITY_OVERFLOW | TICKS_MAX, dtype=np.int64)

    def _scratch(self, n: int) -> None:
        self._sum = np.zeros(n)
        self._key, self._count, self._phase = (np.zeros(n, dtype=np.int64) for _ in range(3))
        self._rows = np.zeros((EDGES + 1, n), dtype=np.int64)
        self._where, self._lifted = self._rows[:EDGES], self._rows[EDGES]
        # h, v/2 and the way the axis sets out on for each edge, and the speed at the end of the step
        self._of_step = np.zeros((3 * EDGES + 1, n))
        self._bend, self._half_speed, self._first_way = self._of_step[:-1].reshape(3, EDGES, n)
        self._last_speed = self._of_step[-1]
        self._square, self._distance, self._root = np.zeros((3, EDGES, n))
        self._shift = np.zeros((EDGES, n), dtype=np.int64)
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
        self._turned = np.zeros(n, dtype=np.bool_)
        self._when, self._peak, self._end, self._bound = (np.zeros(n) for _ in range(4))

    def place(self, x: Floats) -> None:
        """Take `x` (counts) as the position at power-up: the counters start at mid-range wherever the arm is.

        Real filters start low, so that there a line that is high makes an edge at power-up. Left out: whoever counts
        on a position preloads it.
        """
        self._x0[...] = x
        np.floor(x, out=self._was)
        self._was_bytes = self._was.tobytes()
        self._forget(slice(None))

    def power_up(self, board: int) -> None:
        """The FPGA of a board is configured anew (observe first): nothing is left of counts, edges and overflows."""
        self._forget(slice(board * self.width, (board + 1) * self.width))

    def _forget(self, slots: slice) -> None:
        self.preload[slots] = reg.ENCODER_ZERO
        self._pool.queue[:, slots] = _NEVER
        self._state[slots] = NOTHING_SEEN
        self._offset[slots] = reg.ENCODER_ZERO - self._counts()[slots]
        self._overflow[slots] = 0
        self._note_laps()

    def _counts(self) -> Ints:
        """⌊x⌋ as whole numbers."""
        self._count[...] = self._was
        return self._count

    def follow(self, tick: int, span: int, curve: Floats) -> None:
        """A new step begins at `tick`, good for `span` ticks.

        `curve` (3, axes): x0 in counts, v in counts/tick, h in counts/tick². The old step must have been observed to
        its end.
        """
        if tick >= self._lap_due:
            self._watch_laps(tick)
        if span != self._span:
            self._span = span
            self._to_step[-1, _H] = 2.0 * span
        queue, turned = self._pool.queue, self._turned
        self._shift.fill(tick - self.start)
        np.subtract(queue, self._shift, queue)
        self.start = tick
        self._curve[...] = curve
        self._to_step.dot(self._curve, self._of_step)
        np.multiply(self._half_speed, self._half_speed, self._square)
        np.multiply(self._last_speed, self._v, self._sum)  # below 0 where v changes sign within the step
        np.less(self._sum, self._nothing, turned)
        self._turning = 1 in turned.tobytes()
        self._turns = self._find_turns() if self._turning else []

    def _find_turns(self) -> list[float]:
        """Turning points beyond which edges were crossed that lie outside the way from start to end."""
        when, peak, end, bound, work = self._when, self._peak, self._end, self._bound, self._sum
        half_speed = self._half_speed[0]
        when.fill(0.0)
        np.divide(half_speed, self._h, out=when, where=self._turned)  # up to its sign
        np.multiply(half_speed, when, peak)
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
        tau = min(max(tick - self.start, 0), self._span)
        while self._turns and self._turns[0] <= tau:
            turn = self._turns.pop(0)
            self._advance(turn)
            if tick >= self._lap_due:
                self._watch_laps(self.start + int(turn))
        self._advance(tau)

    def _advance(self, tau: float) -> None:
        powers, x = self._powers, self._is
        powers[1], powers[2] = tau, tau * tau
        powers.dot(self._curve, x)
        np.floor(x, x)
        whole = x.tobytes()
        if whole != self._was_bytes:
            self._was_bytes = whole
            self._push()

    def _push(self) -> None:
        """Put the newest edges of every axis that moved in front of its queue."""
        key, distance, root, pool, spare = self._key, self._distance, self._root, self._pool, self._spare
        _TO_KEY.dot(self._terms, self._sum)
        key[...] = self._sum
        _WAYS.take(key, None, self._way, "clip")
        self._push_table.take(key, 1, self._rows, "clip")
        np.add(self._state, self._lifted, key)
        self._state_table.take(key, None, self._state, "clip")
        _TO_EDGES.dot(self._terms, distance)
        # h·τ² + v·τ = distance, solved as distance / (v/2 ± √(v²/4 + h·distance)): + where the axis sets out upwards
        np.multiply(self._bend, distance, root)
        np.add(root, self._square, root)
        np.maximum(root, self._least, out=root)
        np.sqrt(root, root)
        np.copysign(root, self._first_way, root)
        if self._turning:
            self._solve_after_turn(distance, root)
        np.add(root, self._half_speed, root)
        np.divide(distance, root, distance)
        pool.fresh[...] = distance
        np.add(self._where, self._columns, self._where)
        pool.ticks.take(self._where, None, spare.queue, "clip")
        self._pool, self._spare = spare, pool
        self._was[...] = self._is
        self._stale = True

    def _solve_after_turn(self, distance: Floats, root: Floats) -> None:
        """Where the axis first ran the other way it is the other solution, (∓√… - v/2) / h: put as a fraction."""
        after = np.flatnonzero(self._v * self._way < 0.0)
        if after.size:
            half_speed = self._half_speed[:, after]
            distance[:, after] = -(root[:, after] + half_speed) / self._h[after]
            root[:, after] = 1.0 - half_speed
        np.putmask(root, root == -self._half_speed, 1.0)  # the place itself, of an axis that has not moved

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
        moved = self._was != self._lap_was
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
        self._lap_was[:] = self._was
        self._lap_due, self._stale = 0, True
        value &= reg.ENCODER_MASK
        return int(np.minimum(value, reg.ENCODER_MASK - value).min())

    def words(self, tick: int, out: Quads) -> None:
        """Write the encoder quadlets of every axis as seen at `tick` (observe first).

        `out` is (boards, 5, width): position, period, quarter 1, quarter 5 and running.
        """
        pool, spans, running = self._pool, self._spans, self._running
        pool.now.fill(tick - self.start - 1)
        if self._stale:
            if tick >= self._lap_due:
                self._watch_laps(tick)
            self._stale = False
            self._show_counts()
            pool.ticks.take(self._pairs, 0, self._pair_ticks, "clip")
            np.subtract(self._late, self._early, spans)
            np.subtract(spans, self._spent, spans)
            np.maximum(running, self._none, out=running)
            np.greater(spans, self._longest, self._over)
            if 1 in self._over.tobytes():
                np.putmask(spans, self._over, self._too_long)
            np.bitwise_or(self._words, self._word_flags, self._words)
        else:  # only the running counters go on
            np.subtract(pool.now, pool.queue[0], running)
            np.maximum(running, self._none, out=running)
            np.greater(running, self._longest[3], self._over[3])
            np.putmask(running, self._over[3], self._too_long[3])
            np.bitwise_or(running, self._flags[RUNNING], running)
        out[...] = self._words_by_board

    def _show_counts(self) -> None:
        """Counters, flags and pins after a change."""
        count, word, phase, lags = self._counts(), self._word, self._phase, self._lags_shown
        np.bitwise_and(count, self._three, phase)
        np.add(self._state, phase, phase)
        self._flag_table.take(phase, 1, self._flags, "clip")
        if not self._all_lag:
            np.bitwise_and(lags, self._lag, lags)
        np.add(count, self._offset, word)
        np.subtract(word, lags, word)
        np.bitwise_and(word, self._mask, word)
        np.bitwise_or(word, self._overflow, word)
        self._input_pins.dot(self._place, self._inputs)
        self.pins[...] = self._inputs
