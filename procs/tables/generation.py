"""Generations in records of io and arms: each counts changes, and only equality matters. 0: none."""

from __future__ import annotations

from typing import Final

WRAP: Final = 1 << 32
"""They are 32-bit numbers."""


def next_generation(generation: int) -> int:
    """The generation after this one: 1 after the largest, never 0."""
    return generation % (WRAP - 1) + 1
