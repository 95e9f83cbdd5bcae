"""Stages without power, during power-on, and with power only."""

from __future__ import annotations

from typing import Final

from trocar.procs.arm.stages.stage import NEVER_NS, SWITCH_NS, Stage, let_go
from trocar.procs.arm.states import ArmEvent
from trocar.procs.tables import codes

POWER_NS: Final = 3_100_000_000  # io gives up after 3 s, never to be raised, and reports it; else this does


class Disabled(Stage):
    """No power; before power-on io has to clear its fault."""

    def enter(self) -> None:
        let_go(self.control)
        self.control.io_requests.limits.want(True)
        self.control.io_requests.want_no_fault(True)
        self.deadline_ns = NEVER_NS

    def run(self) -> None:
        control, io_requests = self.control, self.control.io_requests
        if not control.machine.goes_on:
            self.deadline_ns = NEVER_NS
            return
        io_requests.want_no_fault(True)
        io_requests.pid.want(False)
        io_requests.power.want(False)
        settled = io_requests.pid.settled and io_requests.power.settled and io_requests.no_fault.settled
        if control.io.fresh and settled and not control.io.amps_on.item():
            control.machine.fire(ArmEvent.ONWARD)
        elif self.deadline_ns == NEVER_NS:
            self.within(SWITCH_NS)
        elif self.is_late:
            self.fail(codes.IO_SWITCH, "io does not get ready for power-on")

    @property
    def waits(self) -> str:
        return "io to become ready for power-on" if self.control.machine.goes_on else ""


class Powering(Stage):
    """Power was requested, once: after a failure, only another operator's command requests it again."""

    def enter(self) -> None:
        self.control.io_requests.pid.want(False)
        self.control.io_requests.power.want(True)
        self.control.io_requests.want_no_fault(False)
        self.within(POWER_NS)

    def run(self) -> None:
        io_requests, io = self.control.io_requests, self.control.io
        if io_requests.power.settled and io.has_power:
            self.control.machine.fire(ArmEvent.POWERED)
        elif self.is_late or (io_requests.is_void and not io.power_requested.item()):
            self.fail(codes.POWER_TIMEOUT, "failed to enable power")  # or an operator's command withdrew it

    @property
    def waits(self) -> str:
        return "motor power and amplifiers"


class Enabled(Stage):
    """Power without motion: brakes hold, the joint controller is off; that of a KINEMATIC robot is on."""

    def enter(self) -> None:
        control, io_requests = self.control, self.control.io_requests
        control.driving = None
        io_requests.power.want(None)  # from now on a loss of power is a fault, not to be repaired
        if not control.held:
            io_requests.brakes.want(False)
            io_requests.pid.want(control.is_kinematic)

    def run(self) -> None:
        if self.control.machine.goes_on:
            self.control.machine.fire(ArmEvent.ONWARD)


class Paused(Stage):
    """The joint controller holds, or stays off; while it holds, it is supervised as before."""

    def enter(self) -> None:
        self.control.io_requests.tracking.want(self.arm.checks_tracking)


class Fault(Stage):
    """No power, until the arm is disabled or enabled again."""

    def enter(self) -> None:
        let_go(self.control)
