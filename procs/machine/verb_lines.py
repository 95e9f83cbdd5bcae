"""Command lines that a message recommends."""

from __future__ import annotations

from typing import Final

DEFAULT_SYSTEM: Final = "trocar"
REMEDY: Final = "trocar "
"""An error that has this names the command to type, and needs no other remedy."""


def verb_line(words: str, system: str) -> str:
    """`trocar WORDS` for a system: with its name where that is not the default."""
    return f"trocar {words}" if system == DEFAULT_SYSTEM else f"trocar {words} --system {system}"
