"""The operating state of setup joints: DISABLED, POWERING, ENABLED, FAULT, and what is answered to state commands."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum
from typing import Final

from trocar.procs.node.requests import Request
from trocar.procs.tables import codes
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
    """What the brakes and the lift get their current from; this one is for carts where nothing has to be powered:
    KINEMATIC, fixed, or with brakes of their own.
    """

    def on(self, now_ns: int) -> None:
        """Begin to power on."""

    def off(self) -> None:
        """Power off at once; brakes hold."""

    def is_on(self) -> bool:
        """Powered, with all that it takes to move brakes."""
        return True

    def problem(self, now_ns: int, *, powering: bool) -> str:
        """What is wrong while power should be there or come; "" when all is well."""
        return ""


class SetupStates:
    """Current and desired state; `enter` is told of each change."""

    def __init__(self, name: str, reports: Events, power: SetupPower, enter: Callable[[SetupState], None]) -> None:
        """DISABLED; `power` is looked at in each step."""
        self.name, self.state, self.desired = name, SetupState.DISABLED, SetupState.DISABLED
        self._reports, self._power, self._enter = reports, power, enter
        self._homed, self._is_beginning = False, False
        self._now_ns = 0
        self._pending: list[Request] = []
        """State commands under way: all ask for `_asked`."""
        self._asked = ""
        self.reason = ""

    @property
    def is_homed(self) -> bool:
        """Homed, and enabled."""
        return self._homed and self.state is SetupState.ENABLED

    @property
    def is_busy(self) -> bool:
        """A transition is under way."""
        return self.state is SetupState.POWERING

    @property
    def published(self) -> str:
        """The state as clients see it."""
        return PUBLISHED.get(self.state, str(self.state))

    def begin(self, state: SetupState, homed: bool, now_ns: int) -> None:
        """Begin in `state`: where a predecessor was, or DISABLED. Power is left as it is."""
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
            self._answer(f"{word} was asked for")
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
        """Look at the power, go on, and answer what has come to its end."""
        if self.state in (SetupState.POWERING, SetupState.ENABLED):
            problem = self._power.problem(now_ns, powering=self.state is SetupState.POWERING)
            if problem:
                self.fault(problem)
            elif self.state is SetupState.POWERING and self._power.is_on():
                self._set(SetupState.ENABLED)
        if not self.is_busy:
            for request in self._pending:
                request.done(str(self.state))
            self._pending.clear()

    @property
    def waits(self) -> str:
        """In FAULT why, else what is waited for; empty: nothing."""
        if self.state is SetupState.FAULT:
            return self.reason
        return "motor power and amplifiers" if self.state is SetupState.POWERING else ""

    def fault(self, reason: str) -> None:
        """Something went wrong: say it, and let the brakes hold."""
        self.reason = reason
        self._reports.report(codes.SUJ_FAULT, f"{self.name}: {reason}", self.name)
        self.desired, self._homed = SetupState.FAULT, False
        self._set(SetupState.FAULT)
        self._answer(reason)

    def publish(self) -> None:
        """Tell the operating state."""
        self._reports.operating_state(self.published, self.state, self.is_homed, self.is_busy)

    def _answer(self, reason: str) -> None:
        for request in self._pending:
            request.fail(reason)
        self._pending.clear()

    def _set(self, state: SetupState) -> None:
        self.state = state
        if state is SetupState.POWERING:
            self._power.on(self._now_ns)
        elif state is not SetupState.ENABLED and not self._is_beginning:
            self._power.off()
        self._enter(state)
        self._reports.status(f"{self.name}: {state}", self.name)
        self.publish()
