"""The version of Trocar."""

from __future__ import annotations

from typing import Final

VERSION: Final = "0.1.0"
"""Equal to that in pyproject.toml, as a test checks: the program runs from its checkout, without package metadata."""
