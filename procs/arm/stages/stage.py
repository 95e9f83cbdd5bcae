"""Common parts of all stages: entry, the work of every cycle, and a deadline."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from trocar.procs.arm.control import Control
from trocar.procs.node.fault_report import FaultReport
from trocar.procs.tables.code_row import Code

if TYPE_CHECKING:
    from trocar.procs.arm.arm import ArmLogic

NEVER_NS: Final = 1 << 62
SWITCH_NS: Final = 1_500_000_000  # io shows a request as done within this time


class Stage:
    """The work of an arm in one state."""

    def __init__(self, arm: ArmLogic) -> None:
        self.arm, self.control = arm, arm.control
        self.deadline_ns = NEVER_NS

    def enter(self) -> None:
        """Called when the state has just been entered."""

    def run(self) -> None:
        """Called once a cycle in the state."""

    @property
    def waits(self) -> str:
        """The awaited condition, in words that follow "PSM1 waits: "; empty: none."""
        return ""

    def within(self, time_ns: int) -> None:
        """Set a deadline: this time from now."""
        self.deadline_ns = self.control.now_ns + time_ns

    @property
    def is_late(self) -> bool:
        """Whether the deadline has passed."""
        return self.control.now_ns >= self.deadline_ns

    def fail(self, code: Code, text: str) -> None:
        """Go to FAULT, with io's answers to the requests that failed."""
        why = self.control.io_requests.refusals
        self.control.machine.fault(FaultReport(code, f"{text} (io says: {why})" if why else text))


def let_go(control: Control) -> None:
    """Drop power, setpoints and homing."""
    control.driving = None
    control.held = False
    control.homed_generation = 0
    io_requests = control.io_requests
    io_requests.brakes.want(None)  # they engage with the loss of power
    io_requests.pid.want(False)
    io_requests.power.want(False)
    io_requests.pots.want(False)
