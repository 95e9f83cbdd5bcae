"""Which Trocar this is."""

from __future__ import annotations

from typing import Final

VERSION: Final = "0.1.0"
"""As in pyproject.toml, which a test sees to: the program runs from its checkout and asks no package for it."""
