"""Colours that are readable on the theme's background, dark or light; every one also has a word beside it."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Palette:
    """Styles of rich, by what they say."""

    past: str
    bad: str
    warning: str
    good: str
    accent: str


DARK = Palette("#8b949e", "#ff7b72", "#e3b341", "#7ee787", "#79c0ff")
LIGHT = Palette("#6a737d", "#b31d28", "#7a4b00", "#176f2c", "#0349b4")


def palette(is_dark: bool) -> Palette:
    """The colours for a background."""
    return DARK if is_dark else LIGHT
