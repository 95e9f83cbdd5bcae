"""Encoder counters and velocity words of all axes of a bus, in closed form from the motion within a physics step.

Within a step the position of an axis, in counts, is x(τ) = x0 + v·τ + h·τ² with τ in ticks since the step began; the
counter is ⌊x⌋ plus what the last preload made of it, and an edge is a crossing of a whole number. Edges are not
simulated one by one: the last six before a moment are the six whole numbers behind x, and solving for their times
gives every quarter period. `observe` brings the six newest edges of each axis up to a moment; what came before the
step stays in the queue. An edge belongs to the first tick at or after its crossing.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from procs.lib import registers as reg

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Quads = npt.NDArray[np.uint32]

EDGES = 6  # five quarter periods lie between six edges
TICKS_MAX = reg.VELOCITY_TICKS_MASK
PINS_SHOWN = 4  # axes whose lines are in the digital input register
LONG_AGO = -(1 << 40)  # tick of edges that never were: older than any counter can tell
_DIRECTION = 16  # above the four bits of an edge's type

_RISING = (reg.EDGE_B_DOWN, reg.EDGE_A_UP, reg.EDGE_B_UP, reg.EDGE_A_DOWN)  # crossing k upwards, by k mod 4
_FALLING = (reg.EDGE_B_UP, reg.EDGE_A_DOWN, reg.EDGE_B_DOWN, reg.EDGE_A_UP)
_PINS = (0, reg.ENCODER_PIN_A, reg.ENCODER_PIN_A | reg.ENCODER_PIN_B, reg.ENCODER_PIN_B)  # by ⌊x⌋ mod 4

# What an axis remembers of its five newest edges beside their ticks: which way each went (bits 4:0, newest lowest,
# 1 is upwards) and how many there ever were (bits above, at most 5). Edges follow in order, so that with ⌊x⌋ mod 4 this
# says of which type each was. States are kept times 16, which leaves room for what is added to look something up.
_WAYS = 32
_SEEN = 5
_STATES = _WAYS * (_SEEN + 1)
_STRIDE = 16
_NOW, _QUEUE = EDGES, EDGES + 1  # rows of a pool: six newest edges, the present tick, the queue
_NOTHING_SEEN = (_WAYS - 1) * _STRIDE


def _push_table(axes: int) -> Ints:
    """What n new edges do to the queue, by n + 6, n from -6 to 6 (column).

    Rows 0-5: where the new queue comes from in a pool, as the start of a flat row of `axes` entries. Row 6: n + 6.
    """
    table = np.zeros((EDGES + 1, 2 * EDGES + 1), dtype=np.int64)
    for n in range(-EDGES, EDGES + 1):
        for j in range(EDGES):
            table[j, n + EDGES] = (j if j < abs(n) else _QUEUE + j - abs(n)) * axes
        table[EDGES, n + EDGES] = n + EDGES
    return table


def _state_table() -> Ints:
    """The next state by state · 16 + n + 6, times 16."""
    table = np.zeros((_STATES, _STRIDE), dtype=np.int64)
    for state in range(_STATES):
        seen, ways = divmod(state, _WAYS)
        for n in range(-EDGES, EDGES + 1):
            new = (1 << abs(n)) - 1 if n > 0 else 0
            after = (ways << abs(n) | new) & _WAYS - 1
            table[state, n + EDGES] = (min(seen + abs(n), _SEEN) * _WAYS + after) * _STRIDE
    return table.ravel()


def _edges_of(state: int, phase: int) -> list[int]:
    """Direction and type, as in the velocity words, of the five newest edges; 0 types are edges that never were."""
    seen, ways = divmod(state, _WAYS)
    edges = []
    for j in range(_SEEN):
        up = ways >> j & 1
        kind = _RISING[phase % 4] if up else _FALLING[(phase + 1) % 4]
        edges.append(up * _DIRECTION | (kind if j < seen else 0))
        phase += -1 if up else 1
    return edges


def _flag_table() -> Ints:
    """By state · 16 + ⌊x⌋ mod 4 (column).

    Rows 0-3: bits of period, quarter 1, quarter 5 and running. Row 4: pins in the position word. Row 5: pins in the
    digital inputs of axis 0.
    """
    table = np.zeros((6, _STATES, _STRIDE), dtype=np.int64)
    for state in range(_STATES):
        for phase in range(4):
            edges = _edges_of(state, phase)
            newest, pins = edges[0], _PINS[phase]
            changed = len({edge & _DIRECTION for edge in edges[:4]}) > 1
            period = ((newest & _DIRECTION) << reg.QUARTER_EDGE_SHIFT | changed * reg.PERIOD_DIRECTION_CHANGED
                      | (0 if edges[3] & 15 else reg.PERIOD_PARTIAL))
            table[:, state, phase] = (
                period, newest << reg.QUARTER_EDGE_SHIFT, edges[4] << reg.QUARTER_EDGE_SHIFT,
                (newest & _DIRECTION if newest & 15 else 0) << reg.QUARTER_EDGE_SHIFT, pins,
                (pins >> 28 & 1) << reg.INPUT_ENCODER_A_SHIFT | (pins >> 29 & 1) << reg.INPUT_ENCODER_B_SHIFT)
    return table.reshape(6, -1)


class Encoders:
    """The encoder inputs of `boards` boards with `width` axes each.

    Every array is flat over the slots, width · board + axis. `preload` and `pins` are for reading: `pins` (boards,)
    holds bits 27:20 of the digital input register, lines A and B of the first four axes.
    """

    def __init__(self, boards: int, width: int = PINS_SHOWN) -> None:
        """All at rest, counters at mid-range, no edge yet."""
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
        self._lap = np.zeros(n, dtype=np.int64)
        self._overflow = np.zeros(n, dtype=np.int64)
        self._state = np.full(n, _NOTHING_SEEN, dtype=np.int64)
        # Two pools take turns: one gather moves the queue from one to the other.
        self._pool = np.zeros((_QUEUE + EDGES, n), dtype=np.int64)
        self._spare = np.zeros_like(self._pool)
        self._pool[_QUEUE:] = (LONG_AGO - np.arange(EDGES) * (TICKS_MAX + 1))[:, None]
        self._constants(n)
        self._scratch(n)

    def _constants(self, n: int) -> None:
        """Whole arrays instead of numbers and rows: numpy takes three times as long to stretch one side."""
        self._push_table, self._state_table, self._flag_table = _push_table(n), _state_table(), _flag_table()
        self._columns = np.tile(np.arange(n, dtype=np.int64), (EDGES, 1))
        self._steps = np.tile(np.arange(EDGES)[:, None] + 0.5, (1, n))
        self._no_less, self._zero = np.full((EDGES, n), 1e-15), np.zeros((EDGES, n))
        self._half, self._six = np.full(n, 0.5), np.full(n, float(EDGES))
        self._three, self._none, self._lap_shift = (np.full(n, k, dtype=np.int64) for k in (3, 0, 24))
        self._mask = np.full(n, reg.ENCODER_MASK, dtype=np.int64)
        self._stretch, self._thrice = np.repeat(np.arange(4), EDGES), np.zeros(3, dtype=np.intp)
        self._place = np.zeros(self.width, dtype=np.int64)
        self._place[:PINS_SHOWN] = 1 << np.arange(PINS_SHOWN)
        # period = E0 - E4 - 4, quarter 1 = E0 - E1 - 1, quarter 5 = E4 - E5 - 1, running = now - E0
        self._pairs = np.array((0, 0, 4, _NOW - _QUEUE, 4, 1, 5, 0)) + _QUEUE
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
        self._flags = np.zeros((6, n), dtype=np.int64)
        self._input_pins = self._flags[5].reshape(-1, self.width)
        self._inputs = np.zeros(n // self.width, dtype=np.int64)
        self._turned = np.zeros(n, dtype=np.bool_)
        self._when, self._peak, self._end, self._bound = (np.zeros(n) for _ in range(4))

    def place(self, x: Floats) -> None:
        """Take `x` (counts) as the position at power-up: the counters start at mid-range wherever the arm is."""
        self._x0[:] = x
        np.floor(x, out=self._whole)
        self._whole_bytes = self._whole.tobytes()
        self._offset[:] = reg.ENCODER_ZERO - self._counts()
        self._lap[:] = 0
        self._stale = True

    def _counts(self) -> Ints:
        """⌊x⌋ as whole numbers."""
        np.copyto(self._count, self._whole, casting="unsafe")
        return self._count

    def follow(self, tick: int, span: int, x0: Floats, v: Floats, h: Floats) -> None:
        """A new step begins at `tick`, good for `span` ticks: x0 in counts, v in counts/tick, h in counts/tick².

        The old step must have been observed to its end. x0 and v are kept as they are, not copied: they must not change
        within the step.
        """
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
            self._advance(self._turns.pop(0))
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
        pool.take(self._where, None, spare[_QUEUE:], "clip")
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
        self.preload[axes] = values
        self._offset[axes] = values - self._counts()[axes]
        self._lap[axes] = 0
        self._stale = True

    def jump(self, axis: int, counts: int) -> None:
        """The counter is wrong by `counts` from now on, as after lost edges."""
        self._offset[axis] += counts
        self._stale = True

    def words(self, tick: int, position: Quads, velocity: Quads) -> None:
        """Write the encoder quadlets of every axis as seen at `tick` (observe first).

        `position` is (boards, width), `velocity` (boards, 4, width): period, quarter 1, quarter 5 and running.
        """
        pool, spans = self._pool, self._spans
        pool[_NOW].fill(tick)
        if self._stale:
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
            np.subtract(pool[_NOW], pool[_QUEUE], running)
            np.maximum(running, self._none, out=running)
            np.greater(running, self._longest[3], self._over[3])
            np.putmask(running, self._over[3], self._too_long[3])
            np.bitwise_or(running, self._flags[3], running)
        position[...] = self._word_by_board
        velocity[...] = self._spans_by_board

    def _show_counts(self) -> None:
        """Position words, flags and pins after a change."""
        count, word, phase, flags = self._counts(), self._word, self._phase, self._flags
        np.add(count, self._offset, word)
        np.right_shift(word, self._lap_shift, phase)
        if phase.tobytes() != self._lap.tobytes():  # over its end; the bit then stays, as in the real one
            self._overflow[phase != self._lap] = reg.ENCODER_OVERFLOW
            self._lap[:] = phase
        np.bitwise_and(count, self._three, phase)
        np.add(self._state, phase, phase)
        self._flag_table.take(phase, 1, flags, "clip")
        np.bitwise_and(word, self._mask, word)
        np.bitwise_or(word, self._overflow, word)
        np.bitwise_or(word, flags[4], word)
        self._input_pins.dot(self._place, self._inputs)
        np.copyto(self.pins, self._inputs, casting="unsafe")
