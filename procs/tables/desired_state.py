"""THE TABLE of what an arm wants of io: each desired state is a field of its setpoints, a flag of io's record is the
answer.

A desired state is NONE, OFF or ON, and counts with the others of its generation; see
docs/decisions/0017-desired-states.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

NONE, OFF, ON = 0, 1, 2

Order = tuple[str, tuple[float, ...]]  # a command of io and its numbers


@dataclass(frozen=True, slots=True)
class DesiredState:
    """Its field in the setpoints, the flag of io's record that shows it, and the commands of io that it stands for."""

    name: str
    shown: str
    on: Order
    off: Order

    @property
    def field(self) -> str:
        """In the setpoints."""
        return f"desired_{self.name}"


def _switch(name: str, shown: str, command: str) -> DesiredState:
    return DesiredState(name, shown, (command, (1.0,)), (command, (0.0,)))


# In the order in which io looks at them: nothing is held or let go before there is power.
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
"""By its command: what only sets how io watches and drives a robot, and takes nothing back that the arm wants."""
SWITCHING: Final = frozenset(
    (*(order[0] for desired in DESIRED_STATES for order in (desired.on, desired.off)), "servo_zero")) - {"", *SETTINGS}
"""Commands of io that do what desired states do: a person's one among them voids the desired states of the robot."""
