"""THE TABLE of an arm's states: what leads from one to the next, what is published, which commands are taken when.

A state leaves by a command (first block) or by something that has come true (second block). A pair that is not in the
table changes nothing. Differences from dVRK 2.4, on purpose: `enable` in FAULT is a new try by way of DISABLED,
`unhome` goes back to ENABLED, and only HOMED takes motion commands.
"""

from __future__ import annotations

from enum import StrEnum


class State(StrEnum):
    """Internal states; the names are published as sub-state."""

    DISABLED = "DISABLED"
    POWERING = "POWERING"
    ENABLED = "ENABLED"
    CALIBRATING = "CALIBRATING_ENCODERS_FROM_POTS"
    BIASED = "ENCODERS_BIASED"
    HOMING = "HOMING"
    HOMED = "HOMED"
    PAUSED = "PAUSED"
    FAULT = "FAULT"


class Event(StrEnum):
    """What moves an arm between its states: the words of `state_command`, then conditions."""

    ENABLE = "enable"
    DISABLE = "disable"
    HOME = "home"
    UNHOME = "unhome"
    PAUSE = "pause"
    RESUME = "resume"
    ONWARD = "onward"  # the state asked for lies further on, and this state's business is done
    POWERED = "powered"  # power is good and every amplifier is on
    BIASED = "biased"  # the encoders were set
    ARRIVED = "arrived"  # the homing goal is reached
    PROBLEM = "problem"  # time-out, lost power, fault of the joint controller, silent or restarted io


COMMANDS = (Event.ENABLE, Event.DISABLE, Event.HOME, Event.UNHOME, Event.PAUSE, Event.RESUME)

TRANSITIONS: dict[tuple[State, Event], State] = {
    (State.POWERING, Event.DISABLE): State.DISABLED,
    (State.ENABLED, Event.DISABLE): State.DISABLED,
    (State.CALIBRATING, Event.DISABLE): State.DISABLED,
    (State.BIASED, Event.DISABLE): State.DISABLED,
    (State.HOMING, Event.DISABLE): State.DISABLED,
    (State.HOMED, Event.DISABLE): State.DISABLED,
    (State.PAUSED, Event.DISABLE): State.DISABLED,
    (State.FAULT, Event.DISABLE): State.DISABLED,
    (State.FAULT, Event.ENABLE): State.DISABLED,
    (State.CALIBRATING, Event.UNHOME): State.ENABLED,
    (State.BIASED, Event.UNHOME): State.ENABLED,
    (State.HOMING, Event.UNHOME): State.ENABLED,
    (State.HOMED, Event.UNHOME): State.ENABLED,
    (State.ENABLED, Event.PAUSE): State.PAUSED,
    (State.CALIBRATING, Event.PAUSE): State.PAUSED,
    (State.BIASED, Event.PAUSE): State.PAUSED,
    (State.HOMING, Event.PAUSE): State.PAUSED,
    (State.HOMED, Event.PAUSE): State.PAUSED,
    (State.PAUSED, Event.RESUME): State.ENABLED,  # or where RESUMES says, of the state that was paused
    (State.DISABLED, Event.ONWARD): State.POWERING,
    (State.POWERING, Event.POWERED): State.ENABLED,
    (State.ENABLED, Event.ONWARD): State.CALIBRATING,
    (State.CALIBRATING, Event.BIASED): State.BIASED,
    (State.BIASED, Event.ONWARD): State.HOMING,
    (State.HOMING, Event.ARRIVED): State.HOMED,
    (State.DISABLED, Event.PROBLEM): State.FAULT,
    (State.POWERING, Event.PROBLEM): State.FAULT,
    (State.ENABLED, Event.PROBLEM): State.FAULT,
    (State.CALIBRATING, Event.PROBLEM): State.FAULT,
    (State.BIASED, Event.PROBLEM): State.FAULT,
    (State.HOMING, Event.PROBLEM): State.FAULT,
    (State.HOMED, Event.PROBLEM): State.FAULT,
    (State.PAUSED, Event.PROBLEM): State.FAULT,
}

# Half-done work is begun again after a pause, not taken up in the middle.
RESUMES: dict[State, State] = {
    State.ENABLED: State.ENABLED,
    State.CALIBRATING: State.ENABLED,
    State.BIASED: State.BIASED,
    State.HOMING: State.BIASED,
    State.HOMED: State.HOMED,
}

PUBLISHED: dict[State, str] = {
    State.DISABLED: "DISABLED",
    State.POWERING: "DISABLED",
    State.ENABLED: "ENABLED",
    State.CALIBRATING: "ENABLED",
    State.BIASED: "ENABLED",
    State.HOMING: "ENABLED",
    State.HOMED: "ENABLED",
    State.PAUSED: "PAUSED",
    State.FAULT: "FAULT",
}

BUSY = frozenset((State.POWERING, State.CALIBRATING, State.HOMING))

ACCEPTED: dict[str, tuple[Event, ...]] = {
    "DISABLED": (Event.ENABLE, Event.DISABLE, Event.UNHOME),
    "ENABLED": (Event.ENABLE, Event.DISABLE, Event.PAUSE, Event.HOME, Event.UNHOME),
    "PAUSED": (Event.DISABLE, Event.PAUSE, Event.RESUME, Event.UNHOME),
    "FAULT": (Event.ENABLE, Event.DISABLE, Event.UNHOME),
}

# The state asked for by each command; resume goes back to what was asked for before the pause.
DESIRES: dict[Event, State] = {
    Event.ENABLE: State.ENABLED,
    Event.DISABLE: State.DISABLED,
    Event.HOME: State.HOMED,
    Event.UNHOME: State.ENABLED,
    Event.PAUSE: State.PAUSED,
}

# States in which the next one is taken as soon as the state asked for lies beyond.
BEYOND: dict[State, frozenset[State]] = {
    State.DISABLED: frozenset((State.ENABLED, State.HOMED)),
    State.ENABLED: frozenset((State.HOMED,)),
    State.BIASED: frozenset((State.HOMED,)),
}


def follow(state: State, event: Event) -> State:
    """The state after `event`; the same one when the pair is not in the table."""
    return TRANSITIONS.get((state, event), state)


def refusal(state: State, word: str) -> str:
    """Why a state_command is not taken now; empty: it is."""
    if word not in COMMANDS:
        known = ", ".join(COMMANDS)
        return f"{word!r} is not a state_command; there are {known}"
    allowed = ACCEPTED[PUBLISHED[state]]
    if word in allowed:
        return ""
    return f"{word} is not allowed in {PUBLISHED[state]} ({state}); allowed are {', '.join(allowed)}"
