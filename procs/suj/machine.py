"""The operating state of setup joints: DISABLED, POWERING, ENABLED, FAULT, and the answers to state commands."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import Final

from trocar.procs.node.fault_report import NO_FAULT, FaultReport
from trocar.procs.tables import codes
from trocar.shm.mailbox.received import Request
from trocar.shm.system.events import Events


class SetupState(StrEnum):
    """Internal states; the names are published as sub-state."""

    DISABLED = "DISABLED"
    POWERING = "POWERING"
    ENABLED = "ENABLED"
    FAULT = "FAULT"


ENABLE, DISABLE, HOME, UNHOME = "enable", "disable", "home", "unhome"
WORDS: Final = (ENABLE, DISABLE, HOME, UNHOME)
PUBLISHED: Final = {SetupState.POWERING: "DISABLED"}  # the others under their own names


class SetupPower:
    """Power of the brakes and the lift; this base class is for carts that need no power: KINEMATIC, fixed, or with
    brakes of their own.
    """

    def on(self, now_ns: int) -> None:
        """Begin to power on."""

    def off(self) -> None:
        """Power off at once; brakes hold."""

    def is_on(self) -> bool:
        """Whether power is on, with everything needed to move brakes."""
        return True

    def problem(self, now_ns: int, *, powering: bool) -> FaultReport:
        """The present problem while power is on or coming up."""
        return NO_FAULT


class SetupStates:
    """Current and desired state; `enter` is called at each change with the previous state."""

    def __init__(self, name: str, reports: Events, power: SetupPower, enter: Callable[[SetupState], None]) -> None:
        """DISABLED; `power` is checked in each step."""
        self.name, self.state, self.desired = name, SetupState.DISABLED, SetupState.DISABLED
        self._reports, self._power, self._enter = reports, power, enter
        self._homed, self._is_beginning = False, False
        self._now_ns = 0
        self._pending: list[Request] = []
        """State commands in progress: all request `_asked`."""
        self._asked = ""
        self.reason = ""

    @property
    def is_homed(self) -> bool:
        """Whether the arms are homed and enabled."""
        return self._homed and self.state is SetupState.ENABLED

    @property
    def is_busy(self) -> bool:
        """Whether a transition is in progress."""
        return self.state is SetupState.POWERING

    @property
    def published(self) -> str:
        """The published state."""
        return PUBLISHED.get(self.state, str(self.state))

    def begin(self, state: SetupState, homed: bool, now_ns: int) -> None:
        """Start in `state`: that of the previous process, or DISABLED. Power is left unchanged."""
        self.desired = SetupState.ENABLED if state is SetupState.POWERING else state
        self._homed, self._now_ns = homed, now_ns
        self._is_beginning = True
        self._set(state)
        self._is_beginning = False

    def command(self, request: Request, now_ns: int) -> None:
        """A state_command; each one publishes the operating state before and after it took effect."""
        word, self._now_ns = request.text.strip(), now_ns
        if word not in WORDS:
            reason = f"state_command {word!r}: allowed are {', '.join(WORDS)}"
            if word in ("pause", "resume"):
                reason = f"{word}: setup joints never move by themselves, so there is nothing to pause"
            self._reports.report(codes.COMMAND_REFUSED, f"{self.name}: {reason}", self.name)
            request.refuse(reason)
            self.publish()
            return
        if word != self._asked:
            self._answer(f"{word} was requested")
        self.publish()
        request.accept()
        self._pending.append(request)
        self._asked = word
        self._homed = {HOME: True, UNHOME: False, DISABLE: False}.get(word, self._homed)
        if word == DISABLE:
            self.desired = SetupState.DISABLED
            self._set(SetupState.DISABLED)
        elif word in (ENABLE, HOME):
            self.desired = SetupState.ENABLED
            if self.state is SetupState.FAULT:
                self._set(SetupState.DISABLED)
            if self.state is SetupState.DISABLED:
                self._set(SetupState.POWERING)
        self.publish()
        self.step(now_ns)

    def step(self, now_ns: int) -> None:
        """Check the power, advance, and answer finished commands."""
        if self.state in (SetupState.POWERING, SetupState.ENABLED):
            problem = self._power.problem(now_ns, powering=self.state is SetupState.POWERING)
            if problem.code is not None:
                self.fault(problem)
            elif self.state is SetupState.POWERING and self._power.is_on():
                self._set(SetupState.ENABLED)
        if not self.is_busy:
            for request in self._pending:
                request.done(str(self.state))
            self._pending.clear()

    @property
    def waits(self) -> str:
        """The cause in FAULT, else the awaited condition; empty: none."""
        if self.state is SetupState.FAULT:
            return self.reason
        return "motor power and amplifiers" if self.state is SetupState.POWERING else ""

    def fault(self, found: FaultReport) -> None:
        """Report a fault, and engage the brakes."""
        self.report(found)
        self.desired, self._homed = SetupState.FAULT, False
        self._set(SetupState.FAULT)
        self._answer(found.words(self.name))

    def report(self, found: FaultReport) -> None:
        """Report the cause of a fault."""
        self.reason = found.text
        if found.code is not None:
            self._reports.report(found.code, found.text, self.name, found.axis, found.value, found.limit, found.board)

    def publish(self) -> None:
        """Report the operating state."""
        self._reports.operating_state(self.published, self.state, self.is_homed, self.is_busy)

    def _answer(self, reason: str) -> None:
        for request in self._pending:
            request.fail(reason)
        self._pending.clear()

    def _set(self, state: SetupState) -> None:
        left, self.state = self.state, state
        if state is SetupState.POWERING:
            self._power.on(self._now_ns)
        elif state is not SetupState.ENABLED and not self._is_beginning:
            self._power.off()
        self._enter(left)
        self._reports.status(f"{self.name}: {state}", self.name)
        self.publish()
