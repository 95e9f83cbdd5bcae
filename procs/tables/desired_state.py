"""THE TABLE of desired states: what an arm requests of io. Each is a field of the arm's setpoints; a flag in io's
record shows the actual state.

A desired state is NONE, OFF or ON, and is valid together with the others of its generation; see
docs/decisions/0017-desired-states.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

NONE, OFF, ON = 0, 1, 2

Order = tuple[str, tuple[float, ...]]  # a command of io and its numbers


@dataclass(frozen=True, slots=True)
class DesiredState:
    """A field in the setpoints, the flag of io's record that shows it, and the equivalent commands of io."""

    name: str
    shown: str
    on: Order
    off: Order

    @property
    def field(self) -> str:
        """Name of the field in the setpoints."""
        return f"desired_{self.name}"


def _switch(name: str, shown: str, command: str) -> DesiredState:
    return DesiredState(name, shown, (command, (1.0,)), (command, (0.0,)))


# In the order in which io processes them: power comes before controllers and brakes.
DESIRED_STATES: Final = (
    DesiredState("fault", "fault", ("", ()), ("clear_fault", ())),
    DesiredState("power", "power_requested", ("power_on", ()), ("power_off", (0.0,))),
    _switch("limits", "limits_enforced", "enforce_limits"),
    _switch("tracking", "tracking_check", "tracking_check"),
    _switch("velocity", "use_setpoint_velocity", "use_setpoint_v"),
    _switch("pots", "pot_check", "pot_check"),
    _switch("pid", "pid_enabled", "pid_enable"),
    DesiredState("brakes", "brakes_released", ("brake_release", ()), ("brake_engage", ())),
)
SETTINGS: Final = {desired.on[0]: desired for desired in DESIRED_STATES if desired.on[1] and desired.name != "pid"}
"""Settings by command: they only change how io monitors and drives a robot, and void no desired state."""
SWITCHING: Final = frozenset(
    (*(order[0] for desired in DESIRED_STATES for order in (desired.on, desired.off)), "servo_zero")) - {"", *SETTINGS}
"""Commands of io with the effect of a desired state: given by a person, they void the robot's desired states."""
