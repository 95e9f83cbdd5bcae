"""Without power, on the way to it, and with nothing but power."""

from __future__ import annotations

from typing import Final

from procs import codes
from procs.arm.control import Control
from procs.arm.stages.stage import NEVER_NS, SWITCH_NS, Stage, let_go
from procs.arm.states import ArmEvent
from procs.arm.supervision import POWER_PROBLEMS

POWER_NS: Final = 3_100_000_000  # io gives up after 3 s, which is never to be raised, and says so; if it does not
TRIES: Final = 2


class Disabled(Stage):
    """No power; on the way up io has to forget its fault first."""

    def enter(self) -> None:
        """See Stage."""
        let_go(self.control)
        self.control.duties.limits.want(True)
        self.control.duties.want_no_fault(True)
        self.deadline_ns = NEVER_NS

    def run(self) -> None:
        """See Stage."""
        control, duties = self.control, self.control.duties
        if not control.machine.goes_on:
            self.deadline_ns = NEVER_NS
            return
        duties.want_no_fault(True)
        duties.pid.want(False)
        duties.power.want(False)
        settled = duties.pid.settled and duties.power.settled and duties.no_fault.settled
        if control.io.fresh and settled and not control.io.amps_on.item():
            control.machine.fire(ArmEvent.ONWARD)
        elif self.deadline_ns == NEVER_NS:
            self.within(SWITCH_NS)
        elif self.is_late:
            self.fail(codes.IO_SWITCH, "io does not get ready for power-on")

    @property
    def waits(self) -> str:
        """See Stage."""
        return "io to get ready for power-on" if self.control.machine.goes_on else ""


class Powering(Stage):
    """Power was asked for; one more try where the first is not enough."""

    def enter(self) -> None:
        """See Stage."""
        self._tries = 0
        self.control.duties.pid.want(None if self.control.is_played else False)  # a played robot's is on with the power
        self._ask()

    def run(self) -> None:
        """See Stage."""
        control, duties, io = self.control, self.control.duties, self.control.io
        if not duties.power.wanted:  # between two tries
            if duties.power.settled and duties.no_fault.settled:
                self._ask()
            elif self.is_late:
                self.fail(codes.POWER_TIMEOUT, "failed to enable power")
        elif duties.power.settled and io.has_power:
            control.machine.fire(ArmEvent.POWERED)
        elif duties.is_void and not (io.problem or io.power_wanted.item()):  # a person took it back
            self.fail(codes.POWER_TIMEOUT, "failed to enable power")
        elif self.is_late or io.problem in POWER_PROBLEMS:
            if self._tries < TRIES:
                duties.power.want(False)
                duties.want_no_fault(True)
                self.within(SWITCH_NS)
            elif io.problem:
                control.machine.fault(control.fault_report(io.problem))
            else:
                self.fail(codes.POWER_TIMEOUT, "failed to enable power")

    def _ask(self) -> None:
        self._tries += 1
        self.control.duties.power.want(True)
        self.control.duties.want_no_fault(False)
        self.within(POWER_NS)

    @property
    def waits(self) -> str:
        """See Stage."""
        return f"motor power and amplifiers (try {self._tries} of {TRIES})"


class Enabled(Stage):
    """Power, and nothing is driven: brakes hold, the joint controller is off."""

    def enter(self) -> None:
        """See Stage."""
        control, duties = self.control, self.control.duties
        control.driving = None
        duties.power.want(None)  # from here on a loss of power is a fault, not a thing to repair
        if not control.held:
            duties.brakes.want(False)
            duties.pid.want(None if control.is_played else False)

    def run(self) -> None:
        """See Stage."""
        if self.control.machine.goes_on:
            self.control.machine.fire(ArmEvent.ONWARD)


class Paused(Stage):
    """The joint controller holds, or stays off; what it did before, it is watched while it holds."""

    def __init__(self, control: Control, checks_tracking: bool) -> None:
        super().__init__(control)
        self._checks_tracking = checks_tracking

    def enter(self) -> None:
        """See Stage."""
        self.control.duties.tracking.want(self._checks_tracking)


class Fault(Stage):
    """No power, until somebody disables the arm or tries again."""

    def enter(self) -> None:
        """See Stage."""
        let_go(self.control)
