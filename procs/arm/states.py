"""THE TABLE of an arm's states: transitions, published names, and the commands allowed in each state.

A state ends by a command (first block) or by a condition (second block); the third block has transitions of some arms
only. A pair that is not in the table changes nothing. Deliberate differences from dVRK 2.4: `enable` in FAULT is a new
try by way of DISABLED, `unhome` goes back to ENABLED, and only HOMED takes motion commands.
"""

from __future__ import annotations

from enum import StrEnum


class ArmState(StrEnum):
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
    MANUAL = "MANUAL"  # PSM, ECM: the clutch on the arm is pressed, the arm is moved by hand
    ENGAGING_ADAPTER = "ENGAGING_ADAPTER"  # PSM
    ENGAGING_TOOL = "ENGAGING_TOOL"  # PSM
    FINDING_ROLL = "CALIBRATING_ROLL"  # MTM: the roll goes to its lower stop
    SETTING_ROLL = "RESETTING_ROLL_ENCODER"  # MTM: its encoder is set there
    OWN = "OWN"  # of a derived arm; published under the name given there


HOMED, FAULT = ArmState.HOMED, ArmState.FAULT  # looked up here: in the class that takes as long as a call

class ArmEvent(StrEnum):
    """Events that move an arm between its states: the words of `state_command`, then conditions."""

    ENABLE = "enable"
    DISABLE = "disable"
    HOME = "home"
    UNHOME = "unhome"
    PAUSE = "pause"
    RESUME = "resume"
    ONWARD = "onward"  # the desired state lies further on, and this state has finished
    POWERED = "powered"  # power is good and every amplifier is on
    BIASED = "biased"  # the encoders were set
    ARRIVED = "arrived"  # the homing goal is reached
    PRESSED = "pressed"  # the clutch on the arm
    RELEASED = "released"
    ADAPTER = "adapter"  # an adapter is attached and has to be engaged
    TOOL = "tool"  # the same for an instrument
    ENGAGED = "engaged"  # or there is nothing left to engage
    ROLL = "roll"  # the roll has to be found
    STOPPED = "stopped"  # the roll is at its stop
    SET = "set"  # its encoder is set
    BEGUN = "begun"  # a state of a derived arm
    ENDED = "ended"
    PROBLEM = "problem"  # timeout, lost power, fault of the joint controller, silent or restarted io


COMMANDS = (ArmEvent.ENABLE, ArmEvent.DISABLE, ArmEvent.HOME, ArmEvent.UNHOME, ArmEvent.PAUSE, ArmEvent.RESUME)

# States with power on, in the order an arm goes through them.
UP = (ArmState.ENABLED, ArmState.CALIBRATING, ArmState.BIASED, ArmState.FINDING_ROLL, ArmState.SETTING_ROLL,
      ArmState.HOMING, ArmState.HOMED,
      ArmState.ENGAGING_ADAPTER, ArmState.ENGAGING_TOOL, ArmState.MANUAL, ArmState.OWN)

TRANSITIONS: dict[tuple[ArmState, ArmEvent], ArmState] = {
    **{(state, ArmEvent.DISABLE): ArmState.DISABLED for state in (ArmState.POWERING, *UP, ArmState.PAUSED,
                                                                  ArmState.FAULT)},
    (ArmState.FAULT, ArmEvent.ENABLE): ArmState.DISABLED,
    **{(state, ArmEvent.UNHOME): ArmState.ENABLED for state in UP if state is not ArmState.ENABLED},
    # SETTING_ROLL, in which nothing moves, ends first: then positions have their new meaning.
    **{(state, ArmEvent.PAUSE): ArmState.PAUSED for state in UP if state is not ArmState.SETTING_ROLL},
    (ArmState.PAUSED, ArmEvent.RESUME): ArmState.ENABLED,  # or the state that RESUMES gives for the paused one

    (ArmState.DISABLED, ArmEvent.ONWARD): ArmState.POWERING,
    (ArmState.POWERING, ArmEvent.POWERED): ArmState.ENABLED,
    (ArmState.ENABLED, ArmEvent.ONWARD): ArmState.CALIBRATING,
    (ArmState.CALIBRATING, ArmEvent.BIASED): ArmState.BIASED,
    (ArmState.BIASED, ArmEvent.ONWARD): ArmState.HOMING,
    (ArmState.HOMING, ArmEvent.ARRIVED): ArmState.HOMED,
    **{(state, ArmEvent.PROBLEM): ArmState.FAULT for state in (ArmState.DISABLED, ArmState.POWERING, *UP,
                                                               ArmState.PAUSED)},

    (ArmState.HOMED, ArmEvent.PRESSED): ArmState.MANUAL,
    (ArmState.MANUAL, ArmEvent.RELEASED): ArmState.HOMED,
    (ArmState.HOMED, ArmEvent.ADAPTER): ArmState.ENGAGING_ADAPTER,
    (ArmState.ENGAGING_ADAPTER, ArmEvent.ENGAGED): ArmState.HOMED,
    (ArmState.HOMED, ArmEvent.TOOL): ArmState.ENGAGING_TOOL,
    (ArmState.ENGAGING_TOOL, ArmEvent.ENGAGED): ArmState.HOMED,
    (ArmState.BIASED, ArmEvent.ROLL): ArmState.FINDING_ROLL,
    (ArmState.FINDING_ROLL, ArmEvent.STOPPED): ArmState.SETTING_ROLL,
    (ArmState.SETTING_ROLL, ArmEvent.SET): ArmState.HOMING,
    (ArmState.HOMED, ArmEvent.BEGUN): ArmState.OWN,
    (ArmState.OWN, ArmEvent.ENDED): ArmState.HOMED,
}

# Unfinished work restarts after a pause, and does not resume in the middle.
RESUMES: dict[ArmState, ArmState] = {
    ArmState.ENABLED: ArmState.ENABLED,
    ArmState.CALIBRATING: ArmState.ENABLED,
    ArmState.BIASED: ArmState.BIASED,
    ArmState.FINDING_ROLL: ArmState.BIASED,
    ArmState.SETTING_ROLL: ArmState.BIASED,
    ArmState.HOMING: ArmState.BIASED,
    ArmState.HOMED: ArmState.HOMED,
    ArmState.ENGAGING_ADAPTER: ArmState.HOMED,
    ArmState.ENGAGING_TOOL: ArmState.HOMED,
    ArmState.MANUAL: ArmState.HOMED,
    ArmState.OWN: ArmState.HOMED,
}

PUBLISHED: dict[ArmState, str] = {
    ArmState.DISABLED: "DISABLED",
    ArmState.POWERING: "DISABLED",
    **dict.fromkeys(UP, "ENABLED"),
    ArmState.PAUSED: "PAUSED",
    ArmState.FAULT: "FAULT",
}

BUSY = frozenset((ArmState.POWERING, *UP)) - {ArmState.ENABLED, ArmState.BIASED, ArmState.HOMED}

# States in which homing is valid: no event in them ends it.
WALLED = frozenset((ArmState.HOMED, ArmState.MANUAL, ArmState.OWN))  # elsewhere motions are the arm's own
AT_HOME = frozenset((ArmState.HOMED, ArmState.ENGAGING_ADAPTER, ArmState.ENGAGING_TOOL, ArmState.MANUAL, ArmState.OWN))

ACCEPTED: dict[str, tuple[ArmEvent, ...]] = {
    "DISABLED": (ArmEvent.ENABLE, ArmEvent.DISABLE, ArmEvent.UNHOME),
    "ENABLED": (ArmEvent.ENABLE, ArmEvent.DISABLE, ArmEvent.PAUSE, ArmEvent.HOME, ArmEvent.UNHOME),
    "PAUSED": (ArmEvent.DISABLE, ArmEvent.PAUSE, ArmEvent.RESUME, ArmEvent.UNHOME),
    "FAULT": (ArmEvent.ENABLE, ArmEvent.DISABLE, ArmEvent.UNHOME),
}

# The same for an arm on its way to power, which is published as DISABLED: `home` then follows the `enable` under way.
ACCEPTED_ENABLING: tuple[ArmEvent, ...] = (*ACCEPTED["DISABLED"], ArmEvent.HOME)

# The desired state of each command; resume goes back to the one before the pause.
DESIRES: dict[ArmEvent, ArmState] = {
    ArmEvent.ENABLE: ArmState.ENABLED,
    ArmEvent.DISABLE: ArmState.DISABLED,
    ArmEvent.HOME: ArmState.HOMED,
    ArmEvent.UNHOME: ArmState.ENABLED,
    ArmEvent.PAUSE: ArmState.PAUSED,
}

# States that are left at once when the desired state lies beyond.
BEYOND: dict[ArmState, frozenset[ArmState]] = {
    ArmState.DISABLED: frozenset((ArmState.ENABLED, ArmState.HOMED)),
    ArmState.ENABLED: frozenset((ArmState.HOMED,)),
    ArmState.BIASED: frozenset((ArmState.HOMED,)),
}


def follow(state: ArmState, event: ArmEvent) -> ArmState:
    """The state after `event`; the same one when the pair is not in the table."""
    return TRANSITIONS.get((state, event), state)


def is_enabling(state: ArmState, desired: ArmState) -> bool:
    """Whether an arm without power is on its way to ENABLED, or beyond."""
    return PUBLISHED[state] == "DISABLED" and desired in BEYOND[ArmState.DISABLED]


def refusal(state: ArmState, desired: ArmState, word: str) -> str:
    """Why a state_command is refused; empty: it is accepted."""
    if word not in COMMANDS:
        known = ", ".join(COMMANDS)
        return f"{word!r} is not a state_command; there are {known}"
    allowed = ACCEPTED_ENABLING if is_enabling(state, desired) else ACCEPTED[PUBLISHED[state]]
    if word in allowed:
        return ""
    return f"{word} is not allowed in {PUBLISHED[state]} ({state}); allowed are {', '.join(allowed)}"
