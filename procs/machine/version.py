"""The version of Trocar."""

from __future__ import annotations

from typing import Final

VERSION: Final = "0.2.0"
"""The only place of it; pyproject.toml reads it here, because the program also runs without package metadata."""
