"""The bring-up of an arm: words of `state_command` for each goal, their time limits, and which word is next.

One rule for the process `system`, the verbs, and scripts on any machine. `word` is the goal's, `asked` the one sent
last, "" before the first; `state` is the published state, "" while the arm shows none.
"""

from __future__ import annotations

from typing import Final

ENABLE, HOME, DISABLE = "enable", "home", "disable"
LIMITS_S: Final = {"": 7.0, DISABLE: 7.0, ENABLE: 7.0, HOME: 60.0}
ORDER: Final = ("", DISABLE, ENABLE, HOME)
ENABLED, HOMED, DISABLED = "enabled", "homed", "disabled"
WORDS: Final = {ENABLED: ENABLE, HOMED: HOME, DISABLED: DISABLE}
"""The word for each goal."""
GOALS: Final = {word: goal for goal, word in WORDS.items()}


def next_word(word: str, asked: str, state: str) -> str:
    """The next word to send; "" if none. No state is needed for `disable`.

    An arm in FAULT is disabled first, and only an arm that shows ENABLED is homed. No word is sent twice, or after a
    later one: an arm that loses its power on the way is not powered again.
    """
    found = {"DISABLED": ENABLE, "FAULT": DISABLE, "ENABLED": HOME}.get(state, "") if word != DISABLE else DISABLE
    return found if ORDER.index(asked) < ORDER.index(found) <= ORDER.index(word) else ""


def most_s(word: str) -> float:
    """The time, s, after which a bring-up has ended if each of its steps takes as long as it may."""
    return sum(LIMITS_S[each] for each in ORDER[: ORDER.index(word) + 1])


def reached(word: str, asked: str, is_done: bool, state: str, is_homed: bool, is_busy: bool) -> bool:
    """Whether the goal is reached; `is_done`: the arm has confirmed the word sent last.

    `disable` is sent even to an arm that shows DISABLED, because it may be about to power on. The goal is reached when
    the arm has confirmed the command and shows DISABLED.
    """
    if word == DISABLE:
        return asked == DISABLE and is_done and state == "DISABLED" and not is_busy
    return state == "ENABLED" and (word == ENABLE or (is_homed and not is_busy))


def obstacle(word: str, asked: str, state: str, name: str, reason: str) -> str:
    """Why the goal is not reached without another command of an operator; "": it may be."""
    if state == "PAUSED" and word != DISABLE:
        return f"it is PAUSED; first: trocar send {name} state_command resume"
    return f"went to FAULT: {reason or 'no reason given'}" if state == "FAULT" and asked in (ENABLE, HOME) else ""


def waits_for(state: str, reason: str) -> str:
    """The condition that an arm waits for, in its own words; "": none."""
    return "" if state == "FAULT" else reason


def late(word: str, state: str, sub_state: str, reason: str, silence: str = "") -> str:
    """The problem of an arm that has not reached its goal in time; `silence`: the cause if it shows no state."""
    if not state:
        how = silence or "it has not shown its state"
    elif word == DISABLE and state == "DISABLED":
        how = "it has not confirmed that its power is off"
    elif waits := waits_for(state, reason):
        how = f"it waits: {waits}"
    else:
        how = f"it is {state if sub_state in ('', state) else f'{state} ({sub_state})'}"
    return f"not {GOALS[word]} in time; {how}"
