"""The motion of one joint in pieces of constant jerk; without a jerk limit, of constant acceleration."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence

Section = tuple[float, float, float]
"""Duration, acceleration at its start, jerk."""
State = tuple[float, float, float, float]
"""Position, velocity, acceleration, jerk."""
Pieces = tuple[tuple[float, ...], tuple[State, ...]]
"""Start times, and states at the start; the last piece has no end."""


def pieces(position: float, velocity: float, sections: Iterable[Section]) -> Pieces:
    """The sections one after the other."""
    starts, states, start_s = [], [], 0.0
    for duration_s, acceleration, jerk in sections:
        state = position, velocity, acceleration, jerk
        starts.append(start_s)
        states.append(state)
        position, velocity, _, _ = _after(state, duration_s)
        start_s += duration_s
    return tuple(starts), tuple(states)


def interval(joints: Sequence[Pieces], time_s: float) -> tuple[float, float, list[State]]:
    """Start and end of the interval with this time in which no joint changes its piece, and the states at its start."""
    found = [(starts, states, bisect_right(starts, time_s)) for starts, states in joints]
    start_s = max(starts[i - 1] for starts, _, i in found)
    end_s = min(starts[i] if i < len(starts) else math.inf for starts, _, i in found)
    return start_s, end_s, [_after(states[i - 1], start_s - starts[i - 1]) for starts, states, i in found]


def _after(state: State, time_s: float) -> State:
    position, velocity, acceleration, jerk = state
    return (position + time_s * (velocity + time_s * (acceleration / 2.0 + time_s * jerk / 6.0)),
            velocity + time_s * (acceleration + time_s * jerk / 2.0), acceleration + time_s * jerk, jerk)
