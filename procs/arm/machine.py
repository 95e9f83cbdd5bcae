"""The operating state of an arm: runs the table of `states.py`, handles `state_command`, and reports changes."""

from __future__ import annotations

from collections.abc import Callable, Container
from typing import Final

from trocar.procs.arm.states import (
    BEYOND,
    BUSY,
    COMMANDS,
    DESIRES,
    PUBLISHED,
    RESUMES,
    UP,
    ArmEvent,
    ArmState,
    follow,
    is_enabling,
    refusal,
)
from trocar.procs.node.fault_report import FaultReport
from trocar.procs.tables import codes
from trocar.shm.mailbox.received import Request
from trocar.shm.system.events import Events

LEADS_TO: Final = {ArmEvent.HOME: ArmEvent.ENABLE}
"""A command that lets an earlier one finish first, and then goes further; any other new command ends earlier ones."""


class ArmStates:
    """Current and desired state; `enter` is called at each change with the previous state."""

    def __init__(
        self, name: str, reports: Events, enter: Callable[[ArmState], None], is_homed: Callable[[], bool]
    ) -> None:
        """`is_homed` is called at each publication."""
        self.name, self.reports = name, reports
        self._enter, self._is_homed = enter, is_homed
        self.state = ArmState.DISABLED
        self.own = ""
        """Published name of OWN, see `begin_own`."""
        self.desired = ArmState.DISABLED
        self.paused = ArmState.ENABLED
        self.reason = self.fault_text = ""
        self.moving = False
        self._desired_before = ArmState.ENABLED
        self._pending: list[tuple[ArmEvent, Request]] = []
        """State commands in progress."""

    @property
    def is_busy(self) -> bool:
        """Whether a transition or a move is in progress."""
        return self.moving or self.state in BUSY

    @property
    def sub_state(self) -> str:
        """The published state name."""
        return self.own if self.state is ArmState.OWN else self.state

    @property
    def goes_on(self) -> bool:
        """Whether the desired state lies beyond the present one."""
        return self.desired in BEYOND.get(self.state, ())

    def publish(self) -> None:
        """Report the operating state."""
        self.reports.operating_state(PUBLISHED[self.state], self.sub_state, self._is_homed(), self.is_busy)

    def publish_refused_move(self) -> None:
        """Report busy, then not busy: a client that waits for a refused move continues at once."""
        self.reports.operating_state(PUBLISHED[self.state], self.sub_state, self._is_homed(), True)
        if not self.moving:
            self.reports.goal_reached(False)
        self.publish()

    def fire(self, event: ArmEvent) -> None:
        """An event occurred."""
        target = follow(self.state, event)
        if self.state is ArmState.PAUSED and event is ArmEvent.RESUME:
            target = RESUMES[self.paused]
        elif event is ArmEvent.SET and self.desired is ArmState.PAUSED:
            target = ArmState.PAUSED
        if target is not self.state:
            self._set(target)

    def begin_own(self, name: str) -> None:
        """From HOMED to a state of a derived arm, published under this name."""
        self.own = name
        self.fire(ArmEvent.BEGUN)

    def fault(self, found: FaultReport) -> None:
        """Report a fault, and stop driving the arm."""
        self.reason, self.fault_text = found.words(self.name), found.text
        if found.code is not None:
            self.reports.report(found.code, found.text, self.name, found.axis, found.value, found.limit, found.board)
        self.fire(ArmEvent.PROBLEM)

    def place(self, state: ArmState, paused: ArmState = ArmState.ENABLED) -> None:
        """Start in `state`, after a restart."""
        self.paused = paused
        self.desired = ArmState.ENABLED if state is ArmState.POWERING else state
        self._desired_before = paused
        self._set(state)

    def forget_desired(self, reason: str) -> None:
        """Drop the desired state of an arm without power."""
        if self.state is ArmState.DISABLED and self.desired is not ArmState.DISABLED:
            self.desired = ArmState.DISABLED
            self._answer_pending(reason)
            self.publish()

    def command(self, request: Request, objection: str) -> bool:
        """A state_command; `objection` refuses it although the table allows it. Returns whether it is accepted."""
        word = request.text.strip()
        reason = refusal(self.state, self.desired, word)
        if not reason and word in (ArmEvent.ENABLE, ArmEvent.HOME):
            reason = objection
        if reason:
            self.reports.report(codes.COMMAND_REFUSED, f"{self.name}: {reason}", self.name)
            request.refuse(reason)
            self.publish()
            return False
        self._carry_out(next(e for e in COMMANDS if e == word), request)
        return True

    def hold(self, request: Request) -> bool:
        """The command `hold` outside HOMED, never refused. Returns whether the request is answered.

        What moves by itself is paused. An arm that waits for io stays without power, and one that gets its power does
        not home.
        """
        if self.state in UP:
            self._carry_out(ArmEvent.PAUSE, request)
            return True
        self.forget_desired("hold was requested")
        if self.state is ArmState.POWERING:
            self.desired = ArmState.ENABLED
            self._answer_pending("hold was requested", spared=(ArmEvent.ENABLE,))
        self.publish()
        return False

    def _carry_out(self, event: ArmEvent, request: Request) -> None:
        self.settle(is_power_off=False)  # what an earlier one of this cycle asks for may be reached already
        self._answer_pending(f"{event} was requested", spared=(event, LEADS_TO.get(event)))
        request.accept()
        self._pending.append((event, request))
        self.publish()
        self._desire(event)
        self.fire(event)
        self.publish()

    def settle(self, *, is_power_off: bool) -> None:
        """Answer the state commands in progress when they have ended."""
        if not self._pending:
            return
        done = [each for each in self._pending if self._is_done(each[0], is_power_off)]
        for each in done:
            self._pending.remove(each)
            each[1].done(self.state)
        if self._pending and self.state is ArmState.FAULT:
            self._answer_pending(self.reason)

    def _is_done(self, event: ArmEvent, is_power_off: bool) -> bool:
        match event:
            case ArmEvent.ENABLE:
                return self.state in UP
            case ArmEvent.HOME:
                return self.state is ArmState.HOMED
            case ArmEvent.DISABLE:
                return self.state is ArmState.DISABLED and is_power_off
            case ArmEvent.PAUSE:
                return self.state is ArmState.PAUSED
            case _:
                return True

    def _answer_pending(self, reason: str, spared: Container[ArmEvent | None] = ()) -> None:
        for event, request in self._pending:
            if event not in spared:
                request.fail(reason)
        self._pending = [each for each in self._pending if each[0] in spared]

    def _desire(self, event: ArmEvent) -> None:
        published = PUBLISHED[self.state]
        if event is ArmEvent.RESUME:
            self.desired = self._desired_before
        elif event is ArmEvent.UNHOME and published != "ENABLED":
            if self.state is ArmState.PAUSED:
                self.paused = self._desired_before = ArmState.ENABLED
            elif is_enabling(self.state, self.desired):
                self.desired = ArmState.ENABLED
        elif event is ArmEvent.PAUSE:
            if self.state is not ArmState.PAUSED:
                self._desired_before, self.desired = self.desired, ArmState.PAUSED
        else:
            self.desired = DESIRES[event]

    def _set(self, target: ArmState) -> None:
        left, self.state = self.state, target
        if target is ArmState.PAUSED and left is not ArmState.DISABLED:
            self.paused = left
        if target is ArmState.FAULT:
            self.desired = ArmState.FAULT
        self._enter(left)
        self.reports.status(f"{self.name}: {self.sub_state}", self.name)
        self.publish()
