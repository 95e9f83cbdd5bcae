"""When each tick was sent, and how many faults there had been: from the newest one that a page has heard follows how
old at most is what it says, and what its person had seen. No clock is compared with another. Pure.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

KEPT: Final = 100
"""Ticks; whoever has heard none of them says nothing that still counts."""


@dataclass(frozen=True, slots=True)
class Tick:
    """One of them; `generation`: how many faults there were, see shm/mailbox/generations.py."""

    sent_ns: int
    generation: int


class Ticks:
    """The newest ones, by their numbers: 1, 2, …"""

    def __init__(self) -> None:
        self.number = 0
        self._sent: dict[int, Tick] = {}

    def add(self, now_ns: int, generation: int) -> int:
        """One more goes out; its number."""
        self.number += 1
        self._sent[self.number] = Tick(now_ns, generation)
        self._sent.pop(self.number - KEPT, None)
        return self.number

    def heard(self, number: int) -> Tick | None:
        """The tick that a page says it has heard; None where that was none, or is too long ago."""
        return self._sent.get(number)
