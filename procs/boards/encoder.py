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
LONG_AGO = -(1 << 40)  # tick of edges that never were: older than any counter can tell

# A queue entry is tick << 5 | direction << 4 | edge type: one gather moves all three.
_DIRECTION = 16
_RISING = (reg.EDGE_B_DOWN, reg.EDGE_A_UP, reg.EDGE_B_UP, reg.EDGE_A_DOWN)  # crossing k upwards, by k mod 4
_FALLING = (reg.EDGE_B_UP, reg.EDGE_A_DOWN, reg.EDGE_B_DOWN, reg.EDGE_A_UP)
_PINS = (0, reg.ENCODER_PIN_A, reg.ENCODER_PIN_A | reg.ENCODER_PIN_B, reg.ENCODER_PIN_B)  # by ⌊x⌋ mod 4


def _push_table(axes: int) -> Ints:
    """What n new edges do to the queue, by 13 · phase + n + 6 (n clipped to ±6, phase = ⌊x⌋ mod 4 after them).

    Rows 0-5: flags of the six newest edges. Rows 6-11: where the new queue comes from in the pool of the six newest
    edges (rows 0-5) and the old queue (rows 6-11), as the start of a flat row of `axes` entries.
    """
    table = np.zeros((2 * EDGES, 52), dtype=np.int64)
    for phase in range(4):
        for n in range(-EDGES, EDGES + 1):
            for j in range(EDGES):
                key = 13 * phase + n + EDGES
                table[j, key] = _RISING[(phase - j) % 4] | _DIRECTION if n > 0 else _FALLING[(phase + 1 + j) % 4]
                table[EDGES + j, key] = (j if j < abs(n) else EDGES + j - abs(n)) * axes
    return table


def _flag_table() -> Ints:
    """Bits of the velocity words by an edge's flags: period, quarter 1, quarter 5, running; then period by edge 4."""
    table = np.zeros((5, 32), dtype=np.int64)
    for flags in range(32):
        table[:, flags] = (flags & _DIRECTION, flags, flags, flags & _DIRECTION if flags & 15 else 0, 0)
    table <<= reg.QUARTER_EDGE_SHIFT
    table[4] = [0 if flags & 15 else reg.PERIOD_PARTIAL for flags in range(32)]
    return table.ravel()


class Encoders:
    """The encoder inputs of `axes` axes; every array is flat over the axes."""

    def __init__(self, axes: int) -> None:
        """All at rest, counters at mid-range, no edge yet."""
        n = axes
        self.preload = np.full(n, reg.ENCODER_ZERO, dtype=np.int64)
        self.pins: Quads = np.zeros(n // 4, dtype=np.uint32)  # (boards,) bits of the digital input register
        self.start = 0  # tick the motion counts from
        self._span = 0.0  # ticks the motion is good for
        self._x0, self._v, self._h = np.zeros(n), np.zeros(n), np.zeros(n)
        self._whole = np.zeros(n)  # ⌊x⌋ when last observed
        self._count = np.zeros(n, dtype=np.int64)
        self._offset = self.preload.copy()  # counter minus ⌊x⌋
        self._turning = False  # some axis turns round within the step
        self._turns: list[float] = []  # turning points still ahead that hide edges from a plain look at ⌊x⌋
        self._stale = True  # flags and pins do not yet show the newest edges
        self._lap = np.zeros(n, dtype=np.int64)
        self._overflow = np.zeros(n, dtype=np.int64)
        # Two pools take turns: one gather moves the queue from one to the other.
        self._pool = np.zeros((2 * EDGES, n), dtype=np.int64)
        self._spare = np.zeros_like(self._pool)
        self._pool[EDGES:] = ((LONG_AGO - np.arange(EDGES) * (TICKS_MAX + 1)) * 32 + _DIRECTION)[:, None]
        self._constants(n)
        self._scratch(n)

    def _constants(self, n: int) -> None:
        """Whole arrays instead of numbers: numpy takes twice as long where one side has to be stretched."""
        self._push_table = _push_table(n)
        self._flag_table = _flag_table()
        self._pin_table = np.array(_PINS, dtype=np.int64)
        pins, axis = self._pin_table[:, None], np.arange(4)
        self._input_table = ((pins >> 28 & 1) << reg.INPUT_ENCODER_A_SHIFT + axis
                             | (pins >> 29 & 1) << reg.INPUT_ENCODER_B_SHIFT + axis).ravel()
        self._axis = np.arange(n, dtype=np.int64) % 4
        self._columns = np.tile(np.arange(n, dtype=np.int64), (EDGES, 1))
        self._steps = np.tile(np.arange(EDGES)[:, None] + 0.5, (1, n))
        self._no_less, self._zero = np.full((EDGES, n), 1e-15), np.zeros((EDGES, n))
        self._most, self._least = (np.full(n, k, dtype=np.int64) for k in (EDGES, -EDGES))
        self._three, self._thirteen = (np.full(n, k, dtype=np.int64) for k in (3, 13))
        self._stretch = np.repeat(np.arange(4), EDGES)
        # period = E0 - E4 - 4, quarter 1 = E0 - E1 - 1, quarter 5 = E4 - E5 - 1, running = now - E0; row 0 is now
        self._pairs = np.array([1, 1, 5, 0, 5, 2, 6, 1])
        self._spent = np.repeat([4, 1, 1, 0], n).reshape(4, n)
        self._longest = np.full((4, n), TICKS_MAX, dtype=np.int64)
        self._flag_rows = np.array([0, 0, 4, 0, 3])
        self._flag_starts = np.repeat(np.arange(5) * 32, n).reshape(5, n)
        self._mask = np.full(n, reg.ENCODER_MASK, dtype=np.int64)

    def _scratch(self, n: int) -> None:
        self._x, self._moved, self._sign, self._half_v, self._x_half = (np.zeros(n) for _ in range(5))
        self._next_count, self._key, self._word, self._phase = (np.zeros(n, dtype=np.int64) for _ in range(4))
        self._push_rows = np.zeros((2 * EDGES, n), dtype=np.int64)
        self._motion = np.zeros((4, n))
        self._stretched = np.zeros((4 * EDGES, n))
        self._ticks = np.zeros((EDGES + 1, n), dtype=np.int64)
        self._pair_ticks = np.zeros((8, n), dtype=np.int64)
        self._flags = np.zeros((5, n), dtype=np.int64)
        self._over = np.zeros((4, n), dtype=np.int64)

    def place(self, x: Floats) -> None:
        """Take `x` (counts) as the position at power-up: the counters start at mid-range wherever the arm is."""
        self._x0[:] = x
        np.floor(x, out=self._whole)
        self._count[:] = self._whole
        self._offset[:] = reg.ENCODER_ZERO - self._count
        self._lap[:] = 0
        self._stale = True

    def follow(self, tick: int, span: int, x0: Floats, v: Floats, h: Floats) -> None:
        """A new step begins at `tick`, good for `span` ticks: x0 in counts, v in counts/tick, h in counts/tick².

        The old step must have been observed to its end.
        """
        self.start, self._span = tick, float(span)
        self._x0[:], self._v[:], self._h[:] = x0, v, h
        np.multiply(self._v, 0.5, self._half_v)
        np.multiply(self._half_v, self._half_v, self._motion[3])
        np.subtract(self._x0, 0.5, self._x_half)
        # v changes sign within the step: v · (v + 2·h·span) < 0
        np.multiply(self._h, 2.0 * span, self._sign)
        np.add(self._sign, self._v, self._sign)
        np.multiply(self._sign, self._v, self._sign)
        turning = self._sign < 0.0
        self._turning = bool(np.count_nonzero(turning))
        self._turns = []
        if self._turning:
            self._find_turns(np.flatnonzero(turning), span)

    def _find_turns(self, axes: npt.NDArray[np.intp], span: int) -> None:
        """Turning points beyond which edges were crossed that lie outside the way from start to end."""
        v, h, x0 = self._v[axes], self._h[axes], self._x0[axes]
        when = -v / (2.0 * h)
        peak = np.floor(x0 + v * when / 2.0)
        end = np.floor(x0 + (v + h * span) * span)
        beyond = (peak > np.maximum(np.floor(x0), end)) | (peak < np.minimum(np.floor(x0), end))
        self._turns = sorted(float(t) for t in when[beyond])

    def observe(self, tick: int) -> None:
        """Bring the edges up to `tick` (not before the last observation; clipped to the step)."""
        tau = min(max(float(tick - self.start), 0.0), self._span)
        while self._turns and self._turns[0] <= tau:
            self._advance(self._turns.pop(0))
        self._advance(tau)

    def _advance(self, tau: float) -> None:
        x = self._x
        np.multiply(self._h, tau, x)
        np.add(x, self._v, x)
        np.multiply(x, tau, x)
        np.add(x, self._x0, x)
        np.floor(x, x)
        np.subtract(x, self._whole, self._moved)
        if np.count_nonzero(self._moved):
            self._push()

    def _push(self) -> None:
        """Put the newest edges of every axis that moved in front of its queue."""
        x, moved, key, motion, sign = self._x, self._moved, self._key, self._motion, self._sign
        self._whole, self._x = x, self._whole
        count, old = self._next_count, self._count
        self._count, self._next_count = count, old
        np.copyto(count, x, casting="unsafe")
        np.subtract(count, old, key)
        np.minimum(key, self._most, out=key)
        np.maximum(key, self._least, out=key)
        np.add(key, self._most, key)
        np.bitwise_and(count, self._three, old)
        np.multiply(old, self._thirteen, old)
        np.add(key, old, key)
        rows = self._push_rows
        self._push_table.take(key, 1, rows, "clip")
        # In the direction of motion s: distance of the newest edge from x0, then one count less for each older edge
        # (upwards the newest edge is ⌊x⌋, downwards ⌊x⌋ + 1).
        np.sign(moved, sign)
        np.subtract(x, self._x_half, motion[0])
        np.multiply(motion[0], sign, motion[0])
        np.multiply(self._h, sign, motion[1])
        np.multiply(self._half_v, sign, motion[2])
        stretched = self._stretched
        motion.take(self._stretch, 0, stretched, "clip")
        wide, root = stretched[:EDGES], stretched[EDGES : 2 * EDGES]
        half_speed, square = stretched[2 * EDGES : 3 * EDGES], stretched[3 * EDGES :]
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
        np.add(fresh, self.start + 1, fresh)
        np.left_shift(fresh, 5, fresh)
        np.bitwise_or(fresh, rows[:EDGES], fresh)
        where = rows[EDGES:]
        np.add(where, self._columns, where)
        pool.take(where, None, spare[EDGES:], "clip")
        self._pool, self._spare = spare, pool
        self._stale = True

    def _solve_after_turn(self, wide: Floats, root: Floats, half_speed: Floats) -> None:
        """Where the axis first ran the other way (w < 0) the root is (√… − w/2) / h': put it as distance over root."""
        after = np.flatnonzero((half_speed[0] < 0.0) & (self._moved != 0.0))
        if after.size:
            wide[:, after] = (root[:, after] - half_speed[:, after]) / self._motion[1, after]
            root[:, after] = 1.0 - half_speed[:, after]

    def load(self, axes: Ints, values: Ints) -> None:
        """Preload registers of `axes` are written: the counters become `values` at once (observe first)."""
        self.preload[axes] = values
        self._offset[axes] = values - self._count[axes]
        self._lap[axes] = 0

    def jump(self, axis: int, counts: int) -> None:
        """The counter is wrong by `counts` from now on, as after lost edges."""
        self._offset[axis] += counts

    def words(self, tick: int, position: Quads, velocity: Quads) -> None:
        """Write the encoder quadlets of every axis as seen at `tick` (observe first).

        `position` is (boards, 4), `velocity` (boards, 4, 4): period, quarter 1, quarter 5 and running, each per axis.
        """
        word, phase = self._word, self._phase
        np.add(self._count, self._offset, word)
        np.right_shift(word, 24, phase)
        if np.count_nonzero(phase != self._lap):  # over its end; the bit then stays, as in the real one
            self._overflow[phase != self._lap] = reg.ENCODER_OVERFLOW
            self._lap[:] = phase
        np.bitwise_and(self._count, self._three, phase)
        if self._stale:
            self._show_edges(phase)
            self._stale = False
        np.bitwise_and(word, self._mask, word)
        np.bitwise_or(word, self._overflow, word)
        np.bitwise_or(word, self._pin_table.take(phase, None, self._key, "clip"), word)
        position[...] = word.reshape(-1, 4)
        ticks, pairs, over = self._ticks, self._pair_ticks, self._over
        ticks[0] = tick
        ticks.take(self._pairs, 0, pairs, "clip")
        spans = pairs[:4]
        np.subtract(spans, pairs[4:], spans)
        np.subtract(spans, self._spent, spans)
        np.subtract(self._longest, spans, over)  # negative where too long
        np.right_shift(over, 63, over)
        np.bitwise_and(over, reg.VELOCITY_OVERFLOW, over)
        np.minimum(spans, self._longest, out=spans)
        np.maximum(spans[3], 0, out=spans[3])
        np.bitwise_or(spans, over, spans)
        np.bitwise_or(spans, self._flags[:4], spans)
        velocity[...] = spans.reshape(4, -1, 4).transpose(1, 0, 2)

    def _show_edges(self, phase: Ints) -> None:
        """Ticks, flags and pins after new edges."""
        queue, flags = self._pool[EDGES:], self._flags
        np.right_shift(queue, 5, self._ticks[1:])
        edge = queue & 31
        selected = edge.take(self._flag_rows, 0)
        np.add(selected, self._flag_starts, selected)
        self._flag_table.take(selected, None, flags, "clip")
        changed = np.bitwise_or.reduce(edge[:4], 0)
        np.bitwise_xor(changed, np.bitwise_and.reduce(edge[:4], 0), changed)
        np.bitwise_and(changed, _DIRECTION, changed)
        np.left_shift(changed, 25, changed)
        np.bitwise_or(flags[0], changed, flags[0])
        np.bitwise_or(flags[0], flags[4], flags[0])
        bits = self._input_table.take(phase * 4 + self._axis).reshape(-1, 4)
        np.copyto(self.pins, np.add.reduce(bits, 1), casting="unsafe")
