"""Command lines for use in messages."""

from __future__ import annotations

from typing import Final

DEFAULT_SYSTEM: Final = "trocar"
REMEDY: Final = "trocar "
"""An error text that contains this names the command to type, and needs no other remedy."""


def verb_line(words: str, system: str) -> str:
    """`trocar WORDS` for a system, with its name unless that is the default."""
    return f"trocar {words}" if system == DEFAULT_SYSTEM else f"trocar {words} --system {system}"
