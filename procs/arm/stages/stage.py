"""What all stages have: the way in, the turn of every cycle, and a deadline."""

from __future__ import annotations

from typing import TYPE_CHECKING, Final

from trocar.procs.arm.control import Control
from trocar.procs.node.fault_report import FaultReport
from trocar.procs.tables.codes import Code

if TYPE_CHECKING:
    from trocar.procs.arm.arm import ArmLogic

NEVER_NS: Final = 1 << 62
SWITCH_NS: Final = 1_500_000_000  # io shows what it was asked for within this


class Stage:
    """One state of an arm at work."""

    def __init__(self, arm: ArmLogic) -> None:
        self.arm, self.control = arm, arm.control
        self.deadline_ns = NEVER_NS

    def enter(self) -> None:
        """The state has just been entered."""

    def run(self) -> None:
        """Once a cycle while in it."""

    @property
    def waits(self) -> str:
        """What the arm waits for in this state, in words that follow "PSM1 waits: "; empty: for nothing."""
        return ""

    def within(self, time_ns: int) -> None:
        """Something has to come true within this time from now."""
        self.deadline_ns = self.control.now_ns + time_ns

    @property
    def is_late(self) -> bool:
        """It has not."""
        return self.control.now_ns >= self.deadline_ns

    def fail(self, code: Code, text: str) -> None:
        """FAULT, with what io said to the requests that failed."""
        why = self.control.io_requests.refusals
        self.control.machine.fault(FaultReport(code, f"{text} (io says: {why})" if why else text))


def let_go(control: Control) -> None:
    """No power, nothing is followed, nothing is known to be homed."""
    control.driving = None
    control.held = False
    control.homed_generation = 0
    io_requests = control.io_requests
    io_requests.brakes.want(None)  # they engage with the power going
    io_requests.pid.want(False)
    io_requests.power.want(False)
    io_requests.pots.want(False)
