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


def _edge_table() -> Ints:
    """Flags of the six newest edges, newest first: row = ⌊x⌋ mod 4, plus 4 when counting up."""
    table = np.zeros((8, EDGES), dtype=np.int64)
    for phase in range(4):
        for j in range(EDGES):
            table[phase, j] = _FALLING[(phase + 1 + j) % 4]
            table[phase + 4, j] = _RISING[(phase - j) % 4] | _DIRECTION
    return table


def _merge_table() -> Ints:
    """Row n: where the queue's entries come from after n edges; 0-5 the new ones, 6-11 the old queue."""
    return np.array([[j if j < n else EDGES + j - n for j in range(EDGES)] for n in range(EDGES + 1)], dtype=np.int64)


class Encoders:
    """The encoder inputs of `axes` axes; every array is flat over the axes."""

    def __init__(self, axes: int) -> None:
        """All at rest, counters at mid-range, no edge yet."""
        self.preload = np.full(axes, reg.ENCODER_ZERO, dtype=np.int64)
        self.period: Quads = np.full(axes, reg.PERIOD_POWER_UP, dtype=np.uint32)
        self.quarters: Quads = np.full((axes, 2), reg.QUARTER_POWER_UP, dtype=np.uint32)
        self.start = 0  # tick the motion counts from
        self._span = 0.0  # ticks the motion is good for
        self._x0 = np.zeros(axes)
        self._v = np.zeros(axes)
        self._h = np.zeros(axes)
        self._whole = np.zeros(axes)  # ⌊x⌋ when last observed
        self._count = np.zeros(axes, dtype=np.int64)
        self._offset = self.preload.copy()  # counter minus ⌊x⌋
        self._turns_back: npt.NDArray[np.bool_] = np.zeros(axes, dtype=np.bool_)
        self._turns: list[float] = []  # turning points still ahead that hide edges from a plain look at ⌊x⌋
        self._queue: Ints = np.tile((LONG_AGO - np.arange(EDGES) * (TICKS_MAX + 1)) * 32 + _DIRECTION, (axes, 1))
        self.pins: Quads = np.zeros(axes // 4, dtype=np.uint32)  # (boards,) bits of the digital input register
        self._stale = True  # the velocity words do not yet show the newest edges
        self._lap = np.zeros(axes, dtype=np.int64)
        self._overflow = np.zeros(axes, dtype=np.int64)
        self._steps = np.arange(EDGES, dtype=np.float64)
        self._edge_table, self._merge_table = _edge_table(), _merge_table()
        self._pins = np.array(_PINS, dtype=np.int64)
        # The pins A and B of an axis have a bit each in its board's digital inputs: row = phase, column = axis.
        self._pin_bits = (self._pins[:, None] >> 28 & 1) << reg.INPUT_ENCODER_A_SHIFT + np.arange(4)
        self._pin_bits |= (self._pins[:, None] >> 29 & 1) << reg.INPUT_ENCODER_B_SHIFT + np.arange(4)
        self._row = (np.arange(axes, dtype=np.int64) * (2 * EDGES))[:, None]
        self._pool = np.zeros((axes, 2 * EDGES), dtype=np.int64)
        self._x, self._moved, self._f, self._g = (np.zeros(axes) for _ in range(4))
        self._wide, self._root = np.zeros((axes, EDGES)), np.zeros((axes, EDGES))
        self._i, self._j = np.zeros(axes, dtype=np.int64), np.zeros(axes, dtype=np.int64)

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
        # v changes sign within the step: v · (v + 2·h·span) < 0
        np.multiply(h, 2.0 * span, out=self._f)
        self._f += v
        self._f *= v
        np.less(self._f, 0.0, out=self._turns_back)
        self._turns = []
        if self._turns_back.any():
            self._find_turns(span)

    def _find_turns(self, span: int) -> None:
        """Turning points beyond which edges were crossed that lie outside the way from start to end."""
        axes = np.flatnonzero(self._turns_back)
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
        x, moved = self._x, self._moved
        np.multiply(self._h, tau, out=x)
        x += self._v
        x *= tau
        x += self._x0
        np.floor(x, out=x)
        np.subtract(x, self._whole, out=moved)
        if moved.any():
            self._push(tau)

    def _push(self, tau: float) -> None:
        """Put the newest edges of every axis that moved in front of its queue."""
        x, moved, f, g, wide, root = self._x, self._moved, self._f, self._g, self._wide, self._root
        axes, queue, pool = self._i, self._queue, self._pool
        self._whole[:] = x
        self._count[:] = x
        np.bitwise_and(self._count, 3, out=axes)
        axes += (moved > 0.0) * 4
        # In the direction of motion s: distance of the newest edge from x0, then one count less for each older edge.
        sign = np.sign(moved)
        x += moved < 0.0
        x -= self._x0
        x *= sign
        np.subtract(x[:, None], self._steps, out=wide)
        # h'·τ² + w·τ = distance, solved as distance / (w/2 + √(w²/4 + h'·distance))
        np.multiply(self._v, sign, out=f)
        f *= 0.5
        np.multiply(self._h, sign, out=g)
        np.multiply(wide, g[:, None], out=root)
        root += (f * f)[:, None]
        np.maximum(root, 0.0, out=root)
        np.sqrt(root, out=root)
        if self._turns_back.any():
            self._solve_after_turn(wide, root, f, g)
        root += f[:, None]
        np.maximum(root, 1e-300, out=root)
        wide /= root
        np.minimum(wide, tau, out=wide)
        np.maximum(wide, 0.0, out=wide)
        np.ceil(wide, out=wide)
        fresh = pool[:, :EDGES]
        fresh[...] = wide
        fresh += self.start
        fresh <<= 5
        fresh |= self._edge_table[axes]
        pool[:, EDGES:] = queue
        np.abs(moved, out=moved)
        np.minimum(moved, EDGES, out=moved)
        self._j[:] = moved
        where = self._merge_table[self._j]
        where += self._row
        np.take(pool, where, out=queue)
        self._stale = True

    def _solve_after_turn(self, wide: Floats, root: Floats, half_speed: Floats, h: Floats) -> None:
        """Where the axis first ran the other way (w < 0) the root is (√… − w/2) / h': put it as distance over root."""
        after = np.flatnonzero((half_speed < 0.0) & (self._moved != 0.0))
        if after.size:
            wide[after] = (root[after] - half_speed[after, None]) / h[after, None]
            root[after] = 1.0 - half_speed[after, None]

    def load(self, axes: Ints, values: Ints) -> None:
        """Preload registers of `axes` are written: the counters become `values` at once (observe first)."""
        self.preload[axes] = values
        self._offset[axes] = values - self._count[axes]
        self._lap[axes] = 0

    def jump(self, axis: int, counts: int) -> None:
        """The counter is wrong by `counts` from now on, as after lost edges."""
        self._offset[axis] += counts

    def words(self, tick: int, position: Quads, period: Quads, quarter_1: Quads, quarter_5: Quads,
              running: Quads) -> None:
        """Write the five encoder quadlets of every axis as seen at `tick`; arrays (boards, 4). Observe first."""
        shape = position.shape
        count, word = self._i, self._j
        np.add(self._count, self._offset, out=word)
        np.right_shift(word, 24, out=count)
        if (count != self._lap).any():  # the counter went over its end; the bit stays, as in the real one
            self._overflow[count != self._lap] = reg.ENCODER_OVERFLOW
            self._lap[:] = count
        word &= reg.ENCODER_MASK
        word |= self._overflow
        np.bitwise_and(self._count, 3, out=count)
        word |= self._pins[count]
        position[...] = word.reshape(shape)
        if self._stale:
            self._velocity()
            self.pins[:] = self._pin_bits[count.reshape(-1, 4), np.arange(4)].sum(axis=1)
            self._stale = False
        period[...] = self.period.reshape(shape)
        quarter_1[...] = self.quarters[:, 0].reshape(shape)
        quarter_5[...] = self.quarters[:, 1].reshape(shape)
        newest = self._queue[:, 0]
        np.right_shift(newest, 5, out=word)
        np.subtract(tick, word, out=word)
        np.maximum(word, 0, out=word)
        over = word > TICKS_MAX
        np.minimum(word, TICKS_MAX, out=word)
        word |= over * np.int64(reg.VELOCITY_OVERFLOW)
        # A counter that has not seen an edge yet shows direction 0 here, though its queue says 1.
        np.bitwise_and(newest, _DIRECTION, out=count)
        count *= (newest & 15) != 0
        count <<= 26
        word |= count
        running[...] = word.reshape(shape)

    def _velocity(self) -> None:
        """Period and quarter words out of the queue."""
        queue = self._queue
        ticks = queue >> 5
        quarters = ticks[:, 0:5:4] - ticks[:, 1:6:4]
        quarters -= 1
        over = quarters > TICKS_MAX
        np.minimum(quarters, TICKS_MAX, out=quarters)
        quarters |= over * np.int64(reg.VELOCITY_OVERFLOW)
        quarters |= (queue[:, 0:5:4] & 31) << reg.QUARTER_EDGE_SHIFT
        self.quarters[...] = quarters
        total = ticks[:, 0] - ticks[:, 4]
        total -= 4
        over = total > TICKS_MAX
        np.minimum(total, TICKS_MAX, out=total)
        total |= over * np.int64(reg.VELOCITY_OVERFLOW)
        total |= (queue[:, 0] & _DIRECTION) << reg.QUARTER_EDGE_SHIFT
        changed = np.bitwise_or.reduce(queue[:, 1:4] ^ queue[:, :1], axis=1) & _DIRECTION
        total |= changed << 25
        total |= ((queue[:, 3] & 15) == 0) * np.int64(reg.PERIOD_PARTIAL)
        self.period[...] = total
