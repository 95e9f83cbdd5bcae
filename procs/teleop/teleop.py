"""Common base of teleoperations of PSMs and of ECMs: states, arms, commands, the record.

Step it once a cycle, then publish the record. It has no clock and no shared memory: time is the `now_ns` argument,
records are arrays given to it. No call waits: the effect of commands to arms shows in their records and answers.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

from trocar.procs.node.requests import STREAM_PAUSE_NS, CommandRefused, Handler, carry_out
from trocar.procs.tables import codes
from trocar.procs.tables.bring_up import HOME, next_word
from trocar.procs.tables.code_row import Code
from trocar.procs.tables.operator_waits import BY_HAND, CLUTCHED
from trocar.procs.teleop.arms import Operator, TeleopArm
from trocar.procs.teleop.record import TeleopRecord
from trocar.shm.mailbox.generations import Cell
from trocar.shm.mailbox.origins import NO_ORIGIN, Origin
from trocar.shm.mailbox.received import Request
from trocar.shm.operator_topics import TeleopState
from trocar.shm.system.events import Events

MARGIN_NS: Final = 50_000_000  # for goals in transit when a stream was ended
SETTING_NS: Final = 60_000_000_000  # time for arms to be homed
REPORT_NS: Final = 2_000_000_000
PRESSED, CLICKED = 1.0, 2.0
NEEDS_ARMS: Final = frozenset((TeleopState.ALIGNING, TeleopState.ENABLED))


@dataclass(frozen=True, slots=True)
class TeleopContext:
    """What a teleoperation needs from its process, besides its arms."""

    operator: Operator
    record: TeleopRecord
    events: Events
    faults: Cell
    """Of its arms; commands given before a fault are void."""


def nothing() -> None:
    """No action."""


class StateRow(NamedTuple):
    """The work of a state: on entry, and every cycle while another state than DISABLED is desired."""

    enter: Callable[[], None] = nothing
    run: Callable[[], None] = nothing


class Teleop:
    """One teleoperation; derived classes add commands, rows of the table of states and the effect of the clutch."""

    words: Mapping[str, TeleopState] = {"enable": TeleopState.ENABLED, "disable": TeleopState.DISABLED}

    def __init__(self, name: str, arms: tuple[TeleopArm, ...], context: TeleopContext) -> None:
        """Starts DISABLED after a restart, too: following begins only after a new command."""
        self.name, self.arms, self.slave, self.faults = name, arms, arms[-1], context.faults
        self.operator, self.record, self.events = context.operator, context.record, context.events
        self.origin: Origin = NO_ORIGIN
        """The operator's command that is carried out."""
        self.state = self.desired = TeleopState.DISABLED
        self.following = self.clutched = False
        self.reason = ""
        self.now_ns = self.entered_ns = self.last_ns = self._paused_until_ns = 0
        self.passed_s = 0.0
        self._reported_ns = -REPORT_NS
        self._asked: dict[str, str] = {}
        self._recovering = False
        """SETTING_ARMS_STATE because an arm was lost, not by command."""
        self.was_refused = False
        """The slave has refused goals since following began."""
        self._table: dict[str, Handler] = {
            "state_command": self._state_command, "clutch": self._clutch, "set_scale": self._set_scale,
            **self.commands()}
        self._states = {TeleopState.SETTING: StateRow(run=self._set_arms), **self.states()}

    # overridden by each kind

    def commands(self) -> Mapping[str, Handler]:
        """Additional commands."""
        return {}

    def states(self) -> Mapping[TeleopState, StateRow]:
        """The work of all states but SETTING_ARMS_STATE; that of DISABLED is to `begin`."""
        return {}

    def look(self) -> None:
        """Read inputs besides the arms."""

    def set_up(self) -> None:
        """All arms are ready: enter the next state, or `stop`."""

    def knows_poses(self) -> bool:
        """Whether the poses needed in ALIGNING_MTM and ENABLED are known; otherwise reports which is not."""
        return True

    def begin_here(self) -> None:
        """Follow from the present poses on."""

    def press(self) -> None:
        """The clutch was pressed; following has ended."""

    def release(self) -> None:
        """The clutch was released while the desired state is DISABLED."""

    def forget_presence(self) -> None:
        """Require the operator to pinch or twist the master's gripper before following resumes."""

    def keep_presence(self) -> None:
        """An interruption as by the clutch: presence need not be shown again."""

    def lose(self) -> None:
        """The operator is absent or not observable while ALIGNING_MTM or ENABLED."""

    def rescale(self, scale: float) -> None:
        """Use another scale from here on; the change itself moves nothing."""

    def show(self) -> None:
        """Fill the kind's own part of the record."""

    # the cycle

    @property
    def is_idle(self) -> bool:
        """Whether the teleoperation is DISABLED and no other state is desired."""
        return self.state is TeleopState.DISABLED and self.desired is TeleopState.DISABLED

    def step(self, now_ns: int, requests: Iterable[Request]) -> None:
        """One cycle: read inputs, answer commands, act, fill the record."""
        self.passed_s = (now_ns - self.last_ns) * 1e-9 if self.last_ns else 0.0
        self.now_ns = self.last_ns = now_ns
        for arm in self.arms:
            arm.look(now_ns)
        was_silent = self.operator.is_silent
        self.operator.look(now_ns)
        self.look()
        self._supervise()
        for request in requests:
            self._command(request)
        if was_silent and not self.operator.is_silent and self.clutched is not self.operator.clutch:
            self.set_clutch(self.operator.clutch)
        if self.state in NEEDS_ARMS and self.operator.absence and self.desired is not TeleopState.DISABLED:
            self.lose()
        if self.desired is not TeleopState.DISABLED and (self.state not in NEEDS_ARMS or (
                all(arm.whole for arm in self.arms) and self.knows_poses())):
            self._states[self.state].run()
        self._show()

    def leave(self, now_ns: int) -> None:
        """The process ends normally: as if disabled."""
        self.now_ns = now_ns
        self.desire(TeleopState.DISABLED)

    def begin(self) -> None:
        """Leave DISABLED: set up the arms."""
        self.go(TeleopState.SETTING)

    def _supervise(self) -> None:
        """Stop after an arm's error or a fault since the enabling command; interrupt if one is silent or restarted."""
        if self.desired is not TeleopState.DISABLED and self.origin.generation < self.faults.valid_from:
            self.stop(codes.FAULT_SINCE, "there has been a fault since it was requested")
        for arm in self.arms:
            errors = arm.errors()
            if self.desired is not TeleopState.DISABLED:
                self._watch(arm, errors)

    def _watch(self, arm: TeleopArm, errors: list[str]) -> None:
        for text in errors:
            self.stop(codes.ARM_ERROR, f"received from arm {arm.name}: {text}", arm.name)
        if arm.stopped_by:
            self.stop(codes.ARM_STOPPED, f"{arm.stopped_by} stopped {arm.name}", arm.name)
            return
        if self.state not in NEEDS_ARMS or errors:
            return
        if arm.is_silent:
            self.interrupt(codes.ARM_TIMEOUT, f"{arm.name} is silent", arm.name)
        elif arm.restarted:
            self.interrupt(codes.ARM_RESTARTED, f"{arm.name} was restarted", arm.name)
        elif arm.rebased:
            self.interrupt(codes.BASE_FRAME, f"the base frame of {arm.name} was changed", arm.name)
        elif arm.fault:
            self.interrupt(codes.ARM_IMPLAUSIBLE, arm.fault, arm.name)
        elif arm.is_in_hand:
            self.events.report(codes.ARM_CLUTCHED, f"{self.name}: {arm.name} is moved by hand", arm.name)
            self._begin_anew()
        elif not arm.is_ready:
            self._miss_arm(arm)

    def _miss_arm(self, arm: TeleopArm) -> None:
        missing = "homed anymore" if arm.is_enabled else f'in state "ENABLED" anymore, it is {arm.reported}'
        self.stop(codes.ARM_NOT_READY, f"{arm.name} is not {missing}", arm.name)

    def interrupt(self, code: Code, text: str, component: str) -> None:
        """Data of an arm are not valid, e.g. because its process has ended: set up again; following needs presence."""
        self.events.report(code, f"{self.name}: {text}", component)
        self._begin_anew()

    def takes_goals(self) -> bool:
        """Whether the slave can be followed on. While it refuses goals it holds, and following begins again from there.

        Afterwards, and when it has ended our stream, back to SETTING_ARMS_STATE, as after the clutch.
        """
        slave = self.slave
        if slave.has_ended_stream:
            self._paused_until_ns = self.now_ns + STREAM_PAUSE_NS + MARGIN_NS
        if slave.has_ended_stream or (self.was_refused and not slave.refuses_goals):
            self.keep_presence()
            self.go(TeleopState.SETTING)
            return False
        if slave.refuses_goals:
            self.was_refused = True
            self.begin_here()
        return True

    def _begin_anew(self) -> None:
        """Back to SETTING_ARMS_STATE; presence has to be shown again.

        There an arm is neither enabled nor homed by command, see `_recovering`.
        """
        self.forget_presence()
        self.go(TeleopState.SETTING)
        self._recovering = True

    def _set_arms(self) -> None:
        """Have all arms enabled and homed, then set up."""
        missing, why = self._missing()
        if not missing:
            if self.now_ns >= self._paused_until_ns and all(arm.whole for arm in self.arms):
                self.set_up()
        elif self.now_ns - self.entered_ns > SETTING_NS:
            for arm in missing:
                self.stop(codes.ARM_SETUP_TIMEOUT,
                          f"timed out while setting up {arm.name} state, it is {arm.reported}", arm.name)
        elif why:
            names = ", ".join(arm.name for arm in missing)
            self.reason = f"waiting: {names} {'is' if len(missing) == 1 else 'are'} {why}"
        elif self._recovering:
            self._miss_arm(missing[0])
        else:
            self._request_home(missing)

    def _missing(self) -> tuple[list[TeleopArm], str]:
        """The arms that are not ready; and why no command to them helps, "": one does."""
        silent, held = ([arm for arm in self.arms if arm.is_silent], [arm for arm in self.arms if arm.is_in_hand])
        if silent or held:
            return silent or held, "silent" if silent else BY_HAND
        return [arm for arm in self.arms if not arm.is_ready], ""

    def _request_home(self, missing: Iterable[TeleopArm]) -> None:
        """Enable arms, then home them; an arm in FAULT is not disabled first, because teleoperations send no stops."""
        for arm in missing:
            word = next_word(HOME, self._asked.get(arm.name, ""), "ENABLED" if arm.is_enabled else "DISABLED")
            if word and arm.send("state_command", (), word):
                self._asked[arm.name] = word
        wanted = ", ".join(f"{arm.name} is {arm.reported}" for arm in missing)
        self.reason = f"waiting: {wanted}; must be ENABLED and homed"

    # changes

    def go(self, state: TeleopState) -> None:
        """Enter a state."""
        if state is not TeleopState.ENABLED:
            self.follow(False)
        self.state, self.entered_ns = state, self.now_ns
        self._asked.clear()
        self._recovering = False
        if state is not TeleopState.DISABLED:
            self.reason = ""
        self.events.emit("current_state", state)
        self.events.status(f"{self.name}: current state is {state}", self.name)
        self._states[state].enter()

    def desire(self, state: TeleopState) -> None:
        """Set another desired state; presence has to be shown for it."""
        if state is self.desired:
            return
        self.desired = state
        self.forget_presence()
        self.events.emit("desired_state", state)
        self.events.status(f"{self.name}: set desired state to {state}", self.name)
        # at once: later commands in this very cycle must find it stopped
        stops = state is TeleopState.DISABLED and self.state is not TeleopState.DISABLED
        if stops or self.state is TeleopState.ENABLED:
            self.go(state)

    def stop(self, code: Code, text: str, component: str = "") -> None:
        """Report a problem; DISABLED from this cycle on, until enabled again."""
        self.reason = text
        self.events.report(code, f"{self.name}: {text}", component or self.name)
        self.desire(TeleopState.DISABLED)

    def follow(self, on: bool) -> None:
        """Let the slave follow, or hold."""
        if on is self.following:
            return
        self.following = on
        if not on:
            self.slave.leave()
        self.events.emit("following", value=float(on))

    def wait(self, reason: str) -> None:
        """Show why the slave does not follow yet, with a warning at intervals."""
        self.reason = reason
        if reason and self.now_ns - self._reported_ns >= REPORT_NS:
            self._reported_ns = self.now_ns
            self.events.report(codes.TELEOP_WAITING, f"{self.name}: {reason}", self.name)

    def settle(self) -> None:
        """A new state: its first reason to wait is reported only if it lasts."""
        self._reported_ns = self.now_ns

    # commands

    def _command(self, request: Request) -> None:
        if reason := carry_out(request, self._do):
            self.events.report(codes.COMMAND_REFUSED, f"{self.name}: {reason}", self.name)

    def _do(self, request: Request) -> str | None:
        handler = self._table.get(request.name)
        if handler is None:
            raise CommandRefused(f"{self.name} has no such command")
        return handler(request)

    def _state_command(self, request: Request) -> None:
        word = request.text
        if word not in self.words:
            raise CommandRefused(f"{word!r}: allowed are {', '.join(self.words)}")
        if word != "disable":
            self._work_for(request.origin)
        self.desire(self.words[word])
        if word == "disable":
            self.reason = ""

    def _work_for(self, origin: Origin) -> None:
        self.origin = origin
        for arm in self.arms:
            arm.commands.on_behalf(origin)

    def _set_scale(self, request: Request) -> None:
        scale = float(request.values[0])
        self.rescale(scale)
        self.record.show_scale(scale)
        self.events.emit("scale", value=scale)

    def _clutch(self, request: Request) -> None:
        """A click repeats the last state."""
        value = float(request.values[0])
        self.set_clutch(self.clutched if value == CLICKED else value == PRESSED)

    def set_clutch(self, pressed: bool) -> None:
        """Handle the console's clutch; it releases or holds the arms while DISABLED, too."""
        self.clutched = pressed
        self.events.status(f"{self.name}: console clutch {'pressed' if pressed else 'released'}", self.name)
        if pressed:
            self.follow(False)
            self.press()
            self.reason = CLUTCHED
        elif self.desired is not TeleopState.DISABLED:
            self.go(TeleopState.SETTING)
        else:
            self.release()
            self.reason = "" if self.reason == CLUTCHED else self.reason

    def _show(self) -> None:
        self.record.show(self.state, self.desired, self.reason, following=self.following, clutched=self.clutched)
        self.record.valid[...] = all(arm.has_pose and not arm.is_silent for arm in self.arms)
        self.show()
