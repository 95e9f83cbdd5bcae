"""Who has control: one browser at a time, while it shows that it is there. Pure.

And when each tick was sent, and how many faults there had been: from the newest one that a page has heard follows how
old at most is what it says, and what its person had seen. No clock is compared with another.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

HEARTBEAT_NS: Final = 2_000_000_000
"""Silence after which a browser has lost control."""
KEPT: Final = 100
"""Ticks; whoever has heard none of them says nothing that still counts."""


class BrowserControl:
    """The browser that may command. Browsers are told apart by their names."""

    def __init__(self) -> None:
        self._holder, self._heard_ns = "", 0

    def holder(self, now_ns: int) -> str:
        """Who has it; empty: nobody, or nobody any more."""
        if self._holder and now_ns - self._heard_ns > HEARTBEAT_NS:
            self._holder = ""
        return self._holder

    def is_free(self, now_ns: int) -> bool:
        """Nobody has it, and nobody who had it was there for so long: who goes from page to page has it in between."""
        return not self.holder(now_ns) and now_ns - self._heard_ns > HEARTBEAT_NS

    def take(self, browser: str, now_ns: int, *, over: bool = False) -> str:
        """Who has it after that: the browser, or another one that it is not taken `over` from."""
        if over or self.holder(now_ns) in ("", browser):
            self._holder, self._heard_ns = browser, now_ns
        return self._holder

    def beat(self, browser: str, now_ns: int, seen_ns: int) -> None:
        """A browser was there when what it has seen was sent: that is what counts, however late it says so.

        One that was silent for too long does not get control back by that.
        """
        if self.holder(now_ns) == browser:
            self._heard_ns = max(self._heard_ns, seen_ns)

    def drop(self, browser: str) -> None:
        """A browser has gone, or gives it back."""
        if self._holder == browser:
            self._holder = ""


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
