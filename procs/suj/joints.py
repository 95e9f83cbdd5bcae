"""Setup joints of one patient cart, a cycle at a time: state, readings, poses, base frames, record."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from trocar.procs.document.cart import Cart
from trocar.procs.node.fault_report import FaultReport
from trocar.procs.node.inputs import Fields
from trocar.procs.suj.classic import Classic
from trocar.procs.suj.frames import CarriedTip, Frames
from trocar.procs.suj.machine import SetupPower, SetupState, SetupStates
from trocar.procs.suj.setup_commands import SetupCommands
from trocar.procs.suj.setups import Setups
from trocar.procs.suj.si import Si
from trocar.procs.tables import codes
from trocar.shm.mailbox.generations import NoFaults, OwnCell
from trocar.shm.mailbox.origins import NO_ORIGIN, Origin
from trocar.shm.mailbox.received import Request
from trocar.shm.memory.layout import shorten
from trocar.shm.system.events import Events

PATIENCE_NS: Final = 1_000_000_000  # for io's first record after a restart
UNFINISHED: Final = FaultReport(codes.POWER_TIMEOUT, "power-on was not complete")


@dataclass(frozen=True, slots=True)
class SetupContext:
    """What setup joints need from their process, besides their configuration."""

    record: Fields  # the arrays of their own record, which may still hold the values of the previous process
    reports: Events
    tips: Sequence[CarriedTip | None]  # of the carried arms, None: none there
    faults: OwnCell = field(default_factory=NoFaults)  # commands given before a fault are void
    on_behalf: Callable[[Origin], None] = lambda origin: None  # receives the origin of each operator's command
    stall: str = ""  # after which the process restarted; empty: it was started


class SetupJoints:
    """All of a process `suj` except shared memory."""

    def __init__(self, cart: Cart, setups: Setups, source: Classic | Si | None, context: SetupContext) -> None:
        """`source` measures the arms' positions, None: not measured."""
        field = context.record
        self._restart = context.stall or "the process was restarted"
        self._cart, self._setups, self._source, self._context = cart, setups, source, context
        classic = source if isinstance(source, Classic) else None
        self._classic = classic
        self._frames = Frames(setups, field)
        self._asked_by = NO_ORIGIN
        self.machine = SetupStates(cart.name, context.reports, classic or SetupPower(), self._enter)
        self._commands = SetupCommands(cart, setups, self.machine, source, self._refer)
        self._shown = {name: field(name) for name in ("valid", "state", "sub_state", "desired_state", "is_homed",
                                                      "is_busy", "simulated", "reference_arm", "reason")}
        self._before = _text(self._shown["sub_state"].item())
        self._was_homed = bool(self._shown["is_homed"].item())
        self._begun_ns = 0
        self._reported: dict[str, object] = {}
        self._reference = self._first_reference(_text(self._shown["reference_arm"].item()))
        if classic is None:
            field("brake_current").fill(np.nan)
        self._settle(source is None)

    def _first_reference(self, before: str) -> int:
        names = self._setups.names
        name = before if before in names else self._cart.reference
        return names.index(name) if name in names else -1

    def _settle(self, reported: bool) -> None:
        """Initial poses: from the previous process's record, else the file, if `reported`; else unknown."""
        for place, arm in enumerate(self._cart.arms):
            if reported and self._before and self._setups.take_over(place):
                continue
            self._setups.lose(place, moved=True)
            if reported and arm.pose is not None:
                self._setups.put(place, np.array(arm.pose))
            elif reported and arm.position:
                self._setups.set_joints(place, np.array(arm.position))

    def step(self, now_ns: int, requests: Iterable[Request]) -> None:
        """One cycle; the caller publishes the record afterwards."""
        if self._source is not None:
            self._source.step(now_ns, self.machine.state)
        if self._before:
            self._begin(now_ns)
        self._commands.execute(map(self._heard, requests), now_ns)
        self.machine.step(now_ns)
        tip = self._context.tips[self._reference] if self._reference >= 0 else None
        self._frames.update(self._reference, tip.name if tip is not None else "",
                            tip.pose(now_ns) if tip is not None else None)
        self._show()

    @property
    def at_rest(self) -> bool:
        """Whether nothing is measured here, and the reference frame did not move in this cycle."""
        return self._source is None and self._frames.still

    def _begin(self, now_ns: int) -> None:
        """Continue the previous process's state, once io's record shows the present one."""
        self._begun_ns = self._begun_ns or now_ns
        before, classic = self._before, self._classic
        if classic is None or before == SetupState.DISABLED:
            self._before = ""
            known = SetupState(before) if before in SetupState.__members__ else SetupState.DISABLED
            self.machine.begin(known, self._was_homed, now_ns)
        elif classic.has_io or now_ns - self._begun_ns > PATIENCE_NS:
            self._before = ""
            classic.go_on()
            if before != SetupState.FAULT and classic.is_powered and classic.is_on():
                self.machine.begin(SetupState.ENABLED, self._was_homed, now_ns)
                return
            if before == SetupState.FAULT:
                self.machine.reason = f"{self._restart}; there was a fault before"
            else:
                found = UNFINISHED if before == SetupState.POWERING else classic.problem(now_ns, powering=False)
                self.machine.report(replace(found, text=f"{found.text}; {self._restart}"))
            self.machine.begin(SetupState.FAULT, False, now_ns)

    def _heard(self, request: Request) -> Request:
        """Note the origin of the next command."""
        self._asked_by = request.origin
        if self._asked_by.id:
            self._context.on_behalf(request.origin)
        return request

    def _enter(self, left: SetupState) -> None:
        state = self.machine.state
        if state is not SetupState.ENABLED and self._source is not None:
            self._source.buttons.cut()
        if state is SetupState.FAULT:
            self._context.faults.fault()
        elif state is SetupState.DISABLED and left is not SetupState.FAULT:
            self._context.faults.void_earlier(self._asked_by)

    def _refer(self, place: int) -> None:
        self._reference = place

    def _show(self) -> None:
        machine = self.machine
        shown: dict[str, object] = {
            "valid": self._setups.valid.all(),
            "state": machine.published.encode(),
            "sub_state": machine.state.encode(),
            "desired_state": machine.desired.encode(),
            "is_homed": machine.is_homed,
            "is_busy": machine.is_busy,
            "reason": shorten(machine.waits, self._shown["reason"].dtype.itemsize),
            "simulated": self._source is None or self._cart.emulated,
            "reference_arm": self._setups.names[self._reference].encode() if self._reference >= 0 else b"",
        }
        if shown != self._reported:
            self._reported = shown
            for name, value in shown.items():
                self._shown[name][...] = value


def _text(cell: bytes) -> str:
    return bytes(cell).rstrip(b"\0").decode(errors="replace")
