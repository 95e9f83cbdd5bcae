"""How arms are brought to a state: by which words of `state_command`, and how long each may take."""

from __future__ import annotations

from typing import Final

ENABLE, HOME, DISABLE = "enable", "home", "disable"
LIMITS_S: Final = {ENABLE: 7.0, HOME: 60.0, DISABLE: 7.0}


def reached(word: str, state: str, is_homed: bool, is_busy: bool) -> bool:
    """Whether an arm that shows this has done what the word asks for."""
    if word == DISABLE:
        return state == "DISABLED" and not is_busy
    return state == "ENABLED" and (word == ENABLE or (is_homed and not is_busy))
