"""What an arm does with each command of its tables: whether it is ready for it, carry it out, answer it.

Every command is answered. What is carried out at once is answered by `done`; a move by `accept`, then by `done` when
it has arrived or `fail` when it has not. A refused command says why; a refused move also gives its busy pair, so that
nobody waits for it.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Final

from procs import codes
from procs.arm.control import REPORT_NS, Control
from procs.arm.motion import Mode
from procs.arm.states import ArmState
from procs.arm.streams import StreamKind
from procs.requests import CommandRefused, Handler, Request, carry_out
from shm.commands import COMMANDS


class Ready(Enum):
    """What a command needs."""

    ALWAYS = "always"
    JOINT = "homed"
    CARTESIAN = "homed, with a tip"
    JAW = "homed, with a jaw"


N: Final = -1
"""As many values as the arm has joints; 2 * N: twice as many."""


@dataclass(frozen=True, slots=True)
class ArmCommandRow:
    """One command: what carries it out, what it needs, how many values it may have (none given: any)."""

    do: Handler
    ready: Ready = Ready.ALWAYS
    sizes: tuple[int, ...] = ()
    moves: bool = False  # who sent it waits for an end


Table = Mapping[str, ArmCommandRow]


class ArmCommands:
    """Carries out the commands of one arm."""

    def __init__(self, control: Control, tables: Iterable[Table]) -> None:
        self._control = control
        self._rows: dict[str, ArmCommandRow] = {}
        for table in tables:
            self._rows.update(table)
        self._stops = {row.name: row.is_stop for row in COMMANDS["arm"] if row.stops}
        self._streams = {row.name: StreamKind(row.stream) for row in COMMANDS["arm"] if row.stream}
        self._timeout_ns = round(control.arm.client_timeout_s * 1e9)
        self._streamed_ns = 0

    def run(self, requests: Iterable[Request]) -> None:
        """Carry out what came in, in order."""
        for request in requests:
            self._one(request)
        if self._streamed_ns:
            self._watch()

    def _one(self, request: Request) -> None:
        row = self._rows.get(request.name)
        if request.command.is_stop(request.text, request.values):
            what = f"{request.name} {request.text}".rstrip()
            self._control.record.show_stop(f"{request.origin.program or 'another program'} ({what})")
        if carry_out(request, self._do, self._control.joints.count):
            if row is not None and row.moves:
                self._control.machine.publish_refused_move()
        elif row is not None and row.ready is not Ready.ALWAYS:
            is_watched = self._timeout_ns and request.name in self._streams
            self._streamed_ns = self._control.now_ns if is_watched else 0

    def _do(self, request: Request) -> str | None:
        row = self._rows.get(request.name)
        if row is None:
            raise CommandRefused(f"{self._control.arm.name} has no such command")
        if not math.isfinite(request.values.dot(request.values)):  # what overflows is out of the question, too
            raise CommandRefused("values must be finite numbers")
        control, streams = self._control, self._control.streams
        kind = self._streams.get(request.name)
        if kind is None:
            is_stop = self._stops.get(request.name)
            if is_stop is not None and is_stop(request.text, request.values):
                self._stop_others(request)
            self._need(request, row)
            text = row.do(request)
            if row.moves:
                streams.lead(request.sender)
            return text
        why = streams.objection(kind, request.sender, lambda: request.origin.program, control.now_ns)
        self._need(request, row)
        if why:
            raise control.refusal(codes.STREAM_REFUSED, request.name, why, REPORT_NS)
        text = row.do(request)
        streams.take(control.now_ns)
        return text

    def _stop_others(self, request: Request) -> None:
        """Whoever else streams has to pause before it goes on."""
        who = request.origin.program or "another program"
        self._control.streams.end(f"{who} stopped the arm ({request.name} {request.text}".rstrip() + ")",
                                  self._control.now_ns, spared=request.sender)

    def _need(self, request: Request, row: ArmCommandRow) -> None:
        """CommandRefused unless the arm is ready for it and the number of values is right."""
        control, state = self._control, self._control.machine.state
        if row.ready is not Ready.ALWAYS:
            if state is not ArmState.HOMED:
                reason = f"arm not ready, it is in {control.machine.sub_state} and must be in {ArmState.HOMED}"
                raise control.refusal(codes.NOT_READY, request.name, reason, REPORT_NS)
            if row.ready is Ready.CARTESIAN and not control.cartesian.valid:
                raise CommandRefused("there is no instrument, so no tip")
            if row.ready is Ready.JAW and not control.joints.has_jaw:
                raise CommandRefused("there is no instrument, so no jaw")
        if not row.sizes or len(request.values) in row.sizes:
            return
        allowed = [size if size >= 0 else -size * control.joints.count for size in row.sizes]
        if len(request.values) not in allowed:
            wanted = f"{' or '.join(map(str, allowed))} value{'s' if allowed != [1] else ''}"
            raise CommandRefused(f"takes {wanted}, {len(request.values)} were given")

    def _watch(self) -> None:
        """A stream that stopped although its client may not: hold."""
        control = self._control
        silent_ns = control.now_ns - self._streamed_ns
        if control.machine.state is ArmState.HOMED and silent_ns <= self._timeout_ns:
            return
        self._streamed_ns = 0
        if control.machine.state is not ArmState.HOMED:
            return  # it was stopped already
        control.stop(control.here, Mode.POSITION, "its client is silent")
        control.report(codes.CLIENT_TIMEOUT, f"no servo command for {silent_ns * 1e-9:.3f} s; holding")
