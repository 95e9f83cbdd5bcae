"""Conditions that put an arm into FAULT, checked each cycle."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from trocar.procs.arm.readings import ArmReadings
from trocar.procs.arm.states import UP, ArmState
from trocar.procs.node.fault_report import NO_FAULT, FaultReport
from trocar.procs.tables import codes

UNWATCHED = frozenset((ArmState.DISABLED, ArmState.FAULT))
MUST_HAVE_POWER = frozenset((*UP, ArmState.PAUSED))


@dataclass(frozen=True, slots=True)
class Generations:
    """The encoder bias and the enable of the joint controller that our setpoints are meant for."""

    bias: int
    pid: int

    @classmethod
    def now(cls, io: ArmReadings) -> Generations:
        """The present ones."""
        return cls(int(io.bias_generation.item()), int(io.pid_generation.item()))


def problem(
    state: ArmState, io: ArmReadings, epoch: int, driving: Generations | None,
            fault_report: Callable[[int], FaultReport],
    power_report: Callable[[], FaultReport],
    io_stall: Callable[[int], str],
) -> FaultReport:
    """The present problem; NO_FAULT if there is none.

    `epoch` is the start count of io at power-on; `driving` is None until the joint controller was seen to follow us.
    """
    if state in UNWATCHED:
        return NO_FAULT
    if not io.fresh:
        return FaultReport(codes.IO_TIMEOUT, "io does not answer")
    if io.epoch != epoch:
        return FaultReport(codes.IO_RESTARTED, io_stall(io.stamp_ns) or codes.IO_RESTARTED.cause)
    if io.problem:
        return fault_report(io.problem)
    if state in MUST_HAVE_POWER and not io.has_power:
        return power_report()
    if driving is None:
        return NO_FAULT
    if not io.pid_enabled.item():
        return FaultReport(codes.PID_OFF, "the joint controller was switched off")
    if io.pid_generation.item() != driving.pid:
        return FaultReport(codes.PID_OFF, "the joint controller was switched off and on again")
    if io.bias_generation.item() != driving.bias and state is not ArmState.SETTING_ROLL:
        return FaultReport(codes.BIAS_CHANGED, "the encoders were set again while the joint controller was on")
    return NO_FAULT
