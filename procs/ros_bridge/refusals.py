"""The bridge's refusals in words: the same text at most once a second, as streams cause many."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

SILENT_NS: Final = 1_000_000_000
KEPT: Final = 1000
"""Texts that are remembered; many have numbers in them."""

Say = Callable[[str], None]


class Refusals:
    """Reported to `warn`."""

    def __init__(self, warn: Say, now_ns: Callable[[], int]) -> None:
        self._warn, self._now_ns = warn, now_ns
        self._silent_until: dict[str, int] = {}

    def say(self, text: str) -> None:
        """Report it, unless it was just reported."""
        now = self._now_ns()
        if now >= self._silent_until.get(text, 0):
            if len(self._silent_until) >= KEPT:
                self._silent_until.clear()
            self._silent_until[text] = now + SILENT_NS
            self._warn(text)
