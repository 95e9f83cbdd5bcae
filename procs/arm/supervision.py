"""What makes an arm go FAULT, asked each cycle."""

from __future__ import annotations

from collections.abc import Callable

from procs.arm.readings import Readings
from procs.arm.states import State
from procs.lib.faults import POWER_TIMEOUT

UNWATCHED = frozenset((State.DISABLED, State.FAULT))
MUST_HAVE_POWER = frozenset(
    (State.ENABLED, State.CALIBRATING, State.BIASED, State.HOMING, State.HOMED, State.PAUSED)
)


def trouble(
    state: State, io: Readings, epoch: int, drives: bool, homed_generation: int, fault_text: Callable[[int], str]
) -> tuple[str, str]:
    """Code and reason of what is wrong, empty when nothing is.

    `epoch` is the life of io that was powered on, `drives` whether the joint controller was seen on,
    `homed_generation` the encoder bias that homing belongs to (0: not homed).
    """
    if state in UNWATCHED:
        return "", ""
    if not io.fresh:
        return "io-silent", "io does not answer"
    if io.epoch != epoch:
        return "io-restarted", "io was restarted"
    if io.problem and not (state is State.POWERING and io.problem == POWER_TIMEOUT.number):  # there is a second try
        return "io-fault", fault_text(io.problem)
    if state in MUST_HAVE_POWER and not io.has_power:
        return "power-loss", "detected power loss (actuators)"
    if drives and not io.pid_enabled.item():
        return "pid-off", "the joint controller was switched off"
    if homed_generation and int(io.bias_generation.item()) != homed_generation:
        return "bias-changed", "the encoders were set anew while the arm was homed"
    return "", ""
