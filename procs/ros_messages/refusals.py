"""The bridge's refusals in words: the same text at most once a second, as streams cause many."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

SILENT_NS: Final = 1_000_000_000
KEPT: Final = 1000
"""Texts that are remembered; many have numbers in them."""

Tell = Callable[[str, str, bool], None]


class Refusals:
    """Reported by `tell`: the instance that the refused message was for ("": none), the text, and whether that contains
    the remedy.
    """

    def __init__(self, tell: Tell, now_ns: Callable[[], int]) -> None:
        self._tell, self._now_ns = tell, now_ns
        self._silent_until: dict[str, int] = {}

    def say(self, to: str, text: str, has_remedy: bool = False) -> None:
        """Report it, unless it was just reported."""
        now = self._now_ns()
        if now >= self._silent_until.get(text, 0):
            if len(self._silent_until) >= KEPT:
                self._silent_until.clear()
            self._silent_until[text] = now + SILENT_NS
            self._tell(to, text, has_remedy)
