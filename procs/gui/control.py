"""Who has control: one browser at a time, while it shows that it is there. Pure."""

from __future__ import annotations

from typing import Final

HEARTBEAT_NS: Final = 2_000_000_000
"""Silence after which a browser has lost control."""


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
