"""Execution of an arm's commands: check that the arm is ready, carry out, answer.

Every command is answered. A command that finishes at once is answered by `done`; a move by `accept`, then by `done` on
arrival or `fail` without it. A refused command gives the reason; a refused move also publishes its busy pair, so that
no client waits for it.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final

from trocar.procs.arm.control import Control
from trocar.procs.arm.motion import Mode
from trocar.procs.arm.reports import REPORT_NS
from trocar.procs.arm.states import FAULT, HOMED
from trocar.procs.node.requests import CommandRefused, Handler, carry_out
from trocar.procs.node.streams import StreamKind
from trocar.procs.tables import codes
from trocar.shm.mailbox.received import Request

KINDS: Final = {kind.value: kind for kind in StreamKind}


class Ready(Enum):
    """Requirements of a command."""

    ALWAYS = "always"
    JOINT = "homed"
    CARTESIAN = "homed, with a tip"
    JAW = "homed, with a jaw"


ALWAYS, _, CARTESIAN, JAW = Ready


@dataclass(frozen=True, slots=True)
class ArmCommandRow:
    """One command: its function and its requirement; all else is in its row of the table of commands."""

    do: Handler
    ready: Ready = ALWAYS


Table = Mapping[str, ArmCommandRow]


class ArmCommands:
    """Carries out the commands of one arm: those in `rows`."""

    def __init__(self, control: Control, rows: dict[str, ArmCommandRow]) -> None:
        self._control, self.rows = control, rows
        self._timeout_ns = round(control.arm.client_timeout_s * 1e9)
        self._streamed_ns = 0

    def run(self, requests: Iterable[Request]) -> None:
        """Carry out received commands, in order."""
        for request in requests:
            self._one(request)
        if self._streamed_ns:
            self._watch()

    def _one(self, request: Request) -> None:
        command = request.command
        if command.stops and command.is_stop(request.text, request.values):
            self._stop_others(request)
        control = self._control
        joints = control.joints.count if control.machine.state is HOMED else None  # else the arm is not ready
        if carry_out(request, self._do, joints) and command.move:
            control.machine.publish_refused_move()

    def _do(self, request: Request) -> str | None:
        command = request.command
        row = self.rows.get(command.name)
        if row is None:
            raise CommandRefused(f"{self._control.arm.name} has no such command")
        control, streams, sender = self._control, self._control.streams, request.sender
        kind = KINDS.get(command.stream)
        why = streams.objection(kind, sender, request, control.now_ns) if kind is not None else ""
        if row.ready is not ALWAYS:
            self._need(command.name, row.ready)
        if why:
            raise control.refusal(codes.STREAM_REFUSED, command.name, why, REPORT_NS, has_remedy=True)
        text = row.do(request)
        if kind is not None:
            streams.take(control.now_ns)
        elif command.move:
            streams.lead(sender)
        if row.ready is not ALWAYS or command.name == "hold":
            self._streamed_ns = control.now_ns if command.stream and self._timeout_ns else 0
        return text

    def _stop_others(self, request: Request) -> None:
        """End the streams of other programs until they have paused, whether the arm is ready or not."""
        control, what = self._control, f"({request.name} {request.text}".rstrip() + ")"
        who = request.sent_by
        control.record.show_stop(f"{request.origin.program or who} {what}")
        control.streams.end(f"{who} stopped the arm {what}", spared=request.sender)

    def _need(self, name: str, ready: Ready) -> None:
        """CommandRefused unless the arm is ready for it."""
        control = self._control
        if control.machine.state is not HOMED:
            reason = f"arm not ready, it is in {control.machine.sub_state} and must be in {HOMED}"
            control.report(codes.NOT_READY, f"{name}: {reason}", REPORT_NS)
            is_fault = control.machine.state is FAULT
            remedy = "trocar status says why" if is_fault else codes.NOT_READY.remedy_for(control.arm.name)
            raise CommandRefused(f"{reason}; {remedy}")
        if ready is CARTESIAN and not control.cartesian.valid:
            raise CommandRefused("there is no instrument, so no tip")
        if ready is JAW and not control.joints.has_jaw:
            raise CommandRefused("there is no instrument, so no jaw")

    def _watch(self) -> None:
        """Hold if no servo command has come for longer than the client timeout."""
        control = self._control
        silent_ns = control.now_ns - self._streamed_ns
        if control.machine.state is HOMED and silent_ns <= self._timeout_ns:
            return
        self._streamed_ns = 0
        if control.machine.state is not HOMED or control.motion.moving:
            return  # already stopped; or the client's jaw stream ran beside a move, and the jaw stays at its last goal
        control.stop(control.here, Mode.POSITION, "its client timed out")
        control.report(codes.CLIENT_TIMEOUT, f"no servo command for {silent_ns * 1e-9:.3f} s; holding")
