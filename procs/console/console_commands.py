"""Execution of a console's commands; refusals give the reason."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

from trocar.procs.console.logic import CAMERA, CLUTCH, OPERATOR, Logic
from trocar.procs.node.debounce import CLICKED, PRESSED, RELEASED
from trocar.procs.node.requests import ANSWERED, CommandRefused, Handler, carry_out, has_left, switch
from trocar.shm.mailbox.received import Request

STAY: Final = "stay"
KINDS: Final = {0.0: RELEASED, 1.0: PRESSED, 2.0: CLICKED}
LET_GO_NS: Final = 1_000_000_000  # time for another console to unselect the conflicting teleoperation


class ConsoleCommands:
    """One method per row of the `console` command table."""

    def __init__(self, logic: Logic, *, has_operator_input: bool = False) -> None:
        """Executes the decisions of `logic`. `has_operator_input`: a pedal or a head sensor detects the operator."""
        self._logic, self._has_operator_input = logic, has_operator_input
        self._emulator: tuple[Request, int] | None = None
        """Program that emulates the operator, while it runs."""
        self._now_ns = 0
        self._waiting: tuple[Request, str, int] | None = None
        self._table: dict[str, Handler] = {
            "teleop_enable": self._enable, "set_scale": self._scale,
            "select_teleop": self._select, "unselect_teleop": self._unselect,
            "emulate_operator_present": self._emulate_operator,
            "emulate_clutch": lambda request: self._emulate(request, CLUTCH),
            "emulate_camera": lambda request: self._emulate(request, CAMERA),
        }

    def execute(self, requests: Iterable[Request], now_ns: int) -> None:
        """Execute received commands, and answer those that waited for another console."""
        self._now_ns = now_ns
        if self._emulator is not None and has_left(*self._emulator):
            self._emulator = None
            self._logic.lose_operator("the program that emulated the operator has ended")
        for request in requests:
            carry_out(request, self._table[request.name])
        self._settle()

    def _settle(self) -> None:
        if self._waiting is None:
            return
        request, teleop, deadline_ns = self._waiting
        if teleop in self._logic.selected:
            self._waiting = None
            request.done()
        elif self._now_ns >= deadline_ns:
            self._waiting = None
            self._logic.forget(teleop)
            request.fail(f"{teleop} was not selected: another console uses one of its arms")

    def _teleop(self, request: Request) -> str:
        name = request.text.strip()
        if not self._logic.knows(name):
            known = ", ".join(member.name for member in self._logic.mine) or "none"
            raise CommandRefused(f"no teleop {name or 'without a name'} in {self._logic.name}; it has {known}")
        return name

    def _enable(self, request: Request) -> None:
        self._logic.enable(switch(request), request.origin)

    def _select(self, request: Request) -> str | None:
        teleop = self._teleop(request)
        if self._waiting is not None:
            self._waiting[0].fail(f"{request.name} {teleop} replaced it")
            self._waiting = None
        if self._logic.select(teleop):
            return None
        request.accept("another console is asked to free its arms")
        self._waiting = request, teleop, self._now_ns + LET_GO_NS
        return ANSWERED

    def _unselect(self, request: Request) -> None:
        self._logic.unselect(self._teleop(request))

    def _scale(self, request: Request) -> None:
        self._logic.set_scale(float(request.values[0]), request.origin)

    def _emulate(self, request: Request, button: str) -> None:
        self._logic.press(button, KINDS[float(request.values[0])])

    def _emulate_operator(self, request: Request) -> str:
        """An emulated operator leaves with the emulating program, unless no other input can detect one."""
        on, stays = bool(request.values[0]), request.text == STAY
        if request.text and not stays:
            raise CommandRefused(f"{request.text!r}; allowed: {STAY}, or no text")
        if stays and self._has_operator_input:
            raise CommandRefused(f"{STAY}: only for a console without a pedal or head sensor for the operator")
        self._emulator = (request, request.pid) if on and not stays else None
        self._logic.press(OPERATOR, PRESSED if on else RELEASED)
        return "present until this program ends" if on and not stays else ""
