"""How arms are brought to a state: by which words of `state_command`, and how long each may take."""

from __future__ import annotations

from typing import Final

ENABLE, HOME, DISABLE = "enable", "home", "disable"
LIMITS_S: Final = {ENABLE: 7.0, HOME: 60.0, DISABLE: 7.0}
ENABLED, HOMED, DISABLED = "enabled", "homed", "disabled"
WORDS: Final = {ENABLED: ENABLE, HOMED: HOME, DISABLED: DISABLE}
"""The word that brings an arm to a goal."""


def next_word(word: str, state: str) -> str:
    """What an arm in this state is asked for next, on its way to what the word asks for; "": nothing.

    In FAULT it is disabled first, and only what shows ENABLED is homed.
    """
    if word == DISABLE or state == "FAULT":
        return DISABLE
    if state == "DISABLED":
        return ENABLE
    return HOME if state == "ENABLED" and word == HOME else ""


def reached(word: str, state: str, is_homed: bool, is_busy: bool) -> bool:
    """Whether an arm that shows this has done what the word asks for."""
    if word == DISABLE:
        return state == "DISABLED" and not is_busy
    return state == "ENABLED" and (word == ENABLE or (is_homed and not is_busy))
