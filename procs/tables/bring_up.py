"""The bring-up of arms: words of `state_command` for each goal, and their time limits."""

from __future__ import annotations

from typing import Final

ENABLE, HOME, DISABLE = "enable", "home", "disable"
LIMITS_S: Final = {ENABLE: 7.0, HOME: 60.0, DISABLE: 7.0}
ENABLED, HOMED, DISABLED = "enabled", "homed", "disabled"
WORDS: Final = {ENABLED: ENABLE, HOMED: HOME, DISABLED: DISABLE}
"""The word for each goal."""


def next_word(word: str, state: str) -> str:
    """The next word to send to an arm in this state, on the way to the goal of `word`; "" if none.

    An arm in FAULT is disabled first, and only an arm that shows ENABLED is homed.
    """
    if word == DISABLE or state == "FAULT":
        return DISABLE
    if state == "DISABLED":
        return ENABLE
    return HOME if state == "ENABLED" and word == HOME else ""


def reached(word: str, state: str, is_homed: bool, is_busy: bool) -> bool:
    """Whether an arm in this state has reached the goal of `word`."""
    if word == DISABLE:
        return state == "DISABLED" and not is_busy
    return state == "ENABLED" and (word == ENABLE or (is_homed and not is_busy))
