"""THE TABLE of an arm's states: what leads from one to the next, what is published, which commands are taken when.

A state leaves by a command (first block) or by something that has come true (second block); the third block has what
only some arms come to. A pair that is not in the table changes nothing. Differences from dVRK 2.4, on purpose:
`enable` in FAULT is a new try by way of DISABLED, `unhome` goes back to ENABLED, and only HOMED takes motion commands.
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
    MANUAL = "MANUAL"  # PSM, ECM: the clutch on the arm is pressed, a hand moves it
    ENGAGING_ADAPTER = "ENGAGING_ADAPTER"  # PSM
    ENGAGING_TOOL = "ENGAGING_TOOL"  # PSM
    FINDING_ROLL = "CALIBRATING_ROLL"  # MTM: the roll goes to its lower stop
    SETTING_ROLL = "RESETTING_ROLL_ENCODER"  # MTM: its encoder is set there


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
    PRESSED = "pressed"  # the clutch on the arm
    RELEASED = "released"
    ADAPTER = "adapter"  # an adapter is on and has to be engaged
    TOOL = "tool"  # so has an instrument
    ENGAGED = "engaged"  # or there is nothing to engage any more
    ROLL = "roll"  # the roll has to be found
    STOPPED = "stopped"  # it stands at its stop
    SET = "set"  # its encoder is set
    PROBLEM = "problem"  # time-out, lost power, fault of the joint controller, silent or restarted io


COMMANDS = (Event.ENABLE, Event.DISABLE, Event.HOME, Event.UNHOME, Event.PAUSE, Event.RESUME)

# States with power on, in the order an arm goes through them.
UP = (State.ENABLED, State.CALIBRATING, State.BIASED, State.FINDING_ROLL, State.SETTING_ROLL, State.HOMING, State.HOMED,
      State.ENGAGING_ADAPTER, State.ENGAGING_TOOL, State.MANUAL)

TRANSITIONS: dict[tuple[State, Event], State] = {
    **{(state, Event.DISABLE): State.DISABLED for state in (State.POWERING, *UP, State.PAUSED, State.FAULT)},
    (State.FAULT, Event.ENABLE): State.DISABLED,
    **{(state, Event.UNHOME): State.ENABLED for state in UP if state is not State.ENABLED},
    **{(state, Event.PAUSE): State.PAUSED for state in UP},
    (State.PAUSED, Event.RESUME): State.ENABLED,  # or where RESUMES says, of the state that was paused

    (State.DISABLED, Event.ONWARD): State.POWERING,
    (State.POWERING, Event.POWERED): State.ENABLED,
    (State.ENABLED, Event.ONWARD): State.CALIBRATING,
    (State.CALIBRATING, Event.BIASED): State.BIASED,
    (State.BIASED, Event.ONWARD): State.HOMING,
    (State.HOMING, Event.ARRIVED): State.HOMED,
    **{(state, Event.PROBLEM): State.FAULT for state in (State.DISABLED, State.POWERING, *UP, State.PAUSED)},

    (State.HOMED, Event.PRESSED): State.MANUAL,
    (State.MANUAL, Event.RELEASED): State.HOMED,
    (State.HOMED, Event.ADAPTER): State.ENGAGING_ADAPTER,
    (State.ENGAGING_ADAPTER, Event.ENGAGED): State.HOMED,
    (State.HOMED, Event.TOOL): State.ENGAGING_TOOL,
    (State.ENGAGING_TOOL, Event.ENGAGED): State.HOMED,
    (State.BIASED, Event.ROLL): State.FINDING_ROLL,
    (State.FINDING_ROLL, Event.STOPPED): State.SETTING_ROLL,
    (State.SETTING_ROLL, Event.SET): State.HOMING,
}

# Half-done work is begun again after a pause, not taken up in the middle.
RESUMES: dict[State, State] = {
    State.ENABLED: State.ENABLED,
    State.CALIBRATING: State.ENABLED,
    State.BIASED: State.BIASED,
    State.FINDING_ROLL: State.BIASED,
    State.SETTING_ROLL: State.BIASED,
    State.HOMING: State.BIASED,
    State.HOMED: State.HOMED,
    State.ENGAGING_ADAPTER: State.HOMED,
    State.ENGAGING_TOOL: State.HOMED,
    State.MANUAL: State.HOMED,
}

PUBLISHED: dict[State, str] = {
    State.DISABLED: "DISABLED",
    State.POWERING: "DISABLED",
    **dict.fromkeys(UP, "ENABLED"),
    State.PAUSED: "PAUSED",
    State.FAULT: "FAULT",
}

BUSY = frozenset((State.POWERING, *UP)) - {State.ENABLED, State.BIASED, State.HOMED}

# States in which homing is valid: what happens in them does not end it.
AT_HOME = frozenset((State.HOMED, State.ENGAGING_ADAPTER, State.ENGAGING_TOOL, State.MANUAL))

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
