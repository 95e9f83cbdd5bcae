"""Effects of encoder edges on the queue of an axis and on its words, as tables.

Besides their ticks, the state of an axis describes its five newest edges: the direction of each (bits 4:0, newest
lowest, 1 is upwards) and the number of edges so far (bits above, at most 5). Edges follow in order, so that ⌊x⌋ mod 4
then gives the type of each. States are stored times 16, which leaves room for additions when a table is indexed.
"""

from __future__ import annotations

import functools

import numpy as np

from trocar.procs.boards.controllers.lines import Ints
from trocar.procs.fpga import registers as reg

EDGES = 6  # six edges span five quarter periods
LAG = 2  # counts by which a counter is behind while the latched direction is up
STRIDE = 16
DIRECTION = 16  # above the four bits of an edge's type
RISING = (reg.EDGE_B_DOWN, reg.EDGE_A_UP, reg.EDGE_B_UP, reg.EDGE_A_DOWN)  # crossing k upwards, by k mod 4
FALLING = (reg.EDGE_B_UP, reg.EDGE_A_DOWN, reg.EDGE_B_DOWN, reg.EDGE_A_UP)
PINS = (0, reg.ENCODER_PIN_A, reg.ENCODER_PIN_A | reg.ENCODER_PIN_B, reg.ENCODER_PIN_B)  # by ⌊x⌋ mod 4
POSITION, PERIOD, QUARTER_1, QUARTER_5, RUNNING, INPUTS, BEHIND = range(7)  # rows of the flags

_WAYS = 32
_SEEN = 5
_STATES = _WAYS * (_SEEN + 1)
NOTHING_SEEN = (_WAYS - 1) * STRIDE  # the queue's directions are up at power-up


@functools.cache
def state_table() -> Ints:
    """The next state by state · 16 + n + 6, times 16."""
    table = np.zeros((_STATES, STRIDE), dtype=np.int64)
    for state in range(_STATES):
        seen, ways = divmod(state, _WAYS)
        for n in range(-EDGES, EDGES + 1):
            new = (1 << abs(n)) - 1 if n > 0 else 0
            after = (ways << abs(n) | new) & _WAYS - 1
            table[state, n + EDGES] = (min(seen + abs(n), _SEEN) * _WAYS + after) * STRIDE
    table.flags.writeable = False
    return table.ravel()


def _edges_of(state: int, phase: int) -> list[int]:
    """Direction and type, as in the velocity words, of the five newest edges; 0 types are edges that never were."""
    seen, ways = divmod(state, _WAYS)
    edges = []
    for j in range(_SEEN):
        up = ways >> j & 1
        kind = RISING[phase % 4] if up else FALLING[(phase + 1) % 4]
        edges.append(up * DIRECTION | (kind if j < seen else 0))
        phase += -1 if up else 1
    return edges


@functools.cache
def flag_table() -> Ints:
    """By state · 16 + ⌊x⌋ mod 4 (column).

    Row 0: pins in the position word. Rows 1-4: bits of period, quarter 1, quarter 5 and running. Row 5: pins in the
    digital inputs of axis 0. Row 6: deficit of a counter while the latched direction is up.
    """
    table = np.zeros((7, _STATES, STRIDE), dtype=np.int64)
    for state in range(_STATES):
        for phase in range(4):
            edges = _edges_of(state, phase)
            newest, pins = edges[0], PINS[phase]
            changed = len({edge & DIRECTION for edge in edges[:4]}) > 1
            up = newest & DIRECTION if newest & 15 else 0
            period = ((newest & DIRECTION) << reg.QUARTER_EDGE_SHIFT | changed * reg.PERIOD_DIRECTION_CHANGED
                      | (0 if edges[3] & 15 else reg.PERIOD_PARTIAL))
            table[:, state, phase] = (
                pins, period, newest << reg.QUARTER_EDGE_SHIFT, edges[4] << reg.QUARTER_EDGE_SHIFT,
                up << reg.QUARTER_EDGE_SHIFT,
                (pins >> 28 & 1) << reg.INPUT_ENCODER_A_SHIFT | (pins >> 29 & 1) << reg.INPUT_ENCODER_B_SHIFT,
                LAG if up else 0)
    table.flags.writeable = False
    return table.reshape(7, -1)
