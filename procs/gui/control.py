"""Control: one browser at a time has it, while its heartbeats arrive. Pure.

Also the time and fault count of each tick sent: the newest tick that a page has received gives the maximum age of its
requests, and the state its person had seen. No clock is compared with another.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

HEARTBEAT_NS: Final = 2_000_000_000
"""Silence after which a browser has lost control."""
KEPT: Final = 100
"""Ticks; requests from a page that has received none of them are out of date."""


class BrowserControl:
    """The browser that may command. Names identify browsers."""

    def __init__(self) -> None:
        self._holder, self._heard_ns = "", 0

    def holder(self, now_ns: int) -> str:
        """The browser in control; empty: none, or none any more."""
        if self._holder and now_ns - self._heard_ns > HEARTBEAT_NS:
            self._holder = ""
        return self._holder

    def is_free(self, now_ns: int) -> bool:
        """Whether no browser had control for a heartbeat timeout; an operator who changes the page keeps control."""
        return not self.holder(now_ns) and now_ns - self._heard_ns > HEARTBEAT_NS

    def take(self, browser: str, now_ns: int, *, over: bool = False) -> str:
        """Returns the browser then in control: this one, or another one if control is not taken `over`."""
        if over or self.holder(now_ns) in ("", browser):
            self._holder, self._heard_ns = browser, now_ns
        return self._holder

    def beat(self, browser: str, now_ns: int, seen_ns: int) -> None:
        """A heartbeat: a browser was there when the tick it has seen was sent; the time of its arrival is ignored.

        A browser that was silent for too long does not regain control by a heartbeat.
        """
        if self.holder(now_ns) == browser:
            self._heard_ns = max(self._heard_ns, seen_ns)

    def drop(self, browser: str) -> None:
        """A browser has left, or gives up control."""
        if self._holder == browser:
            self._holder = ""


@dataclass(frozen=True, slots=True)
class Tick:
    """A tick; `generation`: number of faults at that time, see shm/mailbox/generations.py."""

    sent_ns: int
    generation: int


class Ticks:
    """The newest ones, by their numbers: 1, 2, …"""

    def __init__(self) -> None:
        self.number = 0
        self._sent: dict[int, Tick] = {}
        self._changes: list[tuple[int, int]] = []
        """Number of the tick, and the generation, at each change of it."""

    def add(self, now_ns: int, generation: int) -> int:
        """A new tick is sent; returns its number."""
        self.number += 1
        if not self._changes or generation != self._changes[-1][1]:
            self._changes = [*self._changes[-KEPT:], (self.number, generation)]
        self._sent[self.number] = Tick(now_ns, generation)
        self._sent.pop(self.number - KEPT, None)
        return self.number

    def heard(self, number: int) -> Tick | None:
        """The tick that a page reports as received; None for an unknown or too old one."""
        return self._sent.get(number)

    def generation(self, number: int) -> int:
        """Of the tick of this number, however old it is; 0, that of the oldest, for an unknown one."""
        return next((generation for first, generation in reversed(self._changes) if first <= number <= self.number), 0)
