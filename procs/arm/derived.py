"""Interface for derived arms: a user's class as the process of an arm. docs/derived-arms.md.

    from trocar.procs.arm.derived import DerivedPsm, State

    class Mine(DerivedPsm):
        states = {"SCANNING": Scanning}     # Scanning is a State

        def on_scan(self, width):           # a command that the system file declares
            self.begin("SCANNING")
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from trocar.procs.arm.arm import ArmLogic
from trocar.procs.arm.arm_commands import ArmCommandRow, Ready
from trocar.procs.arm.context import ArmContext
from trocar.procs.arm.ecm import EcmLogic
from trocar.procs.arm.motion import Mode, Space
from trocar.procs.arm.mtm.mtm import MtmLogic
from trocar.procs.arm.psm.psm import PsmLogic
from trocar.procs.arm.stages.stage import Stage
from trocar.procs.arm.states import ArmEvent, ArmState
from trocar.procs.crtk.user_rows import arguments_of, command_row, handler_of
from trocar.procs.document.system import ArmConfig
from trocar.procs.document.user_process import UserCommand
from trocar.procs.node.requests import CommandRefused
from trocar.procs.tables import codes
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.command_row import FREE
from trocar.shm.mailbox.received import Request

MAX_NAME: Final = 23
"""Size of the name of a state, bytes."""


class State(Stage):
    """A state of a derived arm, reached from HOMED: `enter` once, `run` each cycle until `arm.end()`."""

    arm: DerivedArm

    @property
    def now_s(self) -> float:
        """The time of this cycle, s."""
        return self.control.now_ns * 1e-9


class Guarded(Stage):
    """The present user state. A request of the state that is refused ends it, and is reported."""

    arm: DerivedArm

    def __init__(self, arm: DerivedArm) -> None:
        super().__init__(arm)
        self.inner = Stage(arm)

    def _try(self, do: Callable[[], None]) -> None:
        try:
            do()
        except CommandRefused as why:
            self.control.report(codes.OWN_STATE, f"{self.control.machine.sub_state} ended: {why}")
            self.arm.end()

    def enter(self) -> None:
        self._try(self.inner.enter)

    def run(self) -> None:
        self._try(self.inner.run)

    @property
    def waits(self) -> str:
        return self.inner.waits


class DerivedArm(ArmLogic):
    """Additions of a derived arm to its base class: `on_NAME` for each declared command, and states."""

    states: ClassVar[Mapping[str, type[State]]] = {}
    """Its own states by their published names."""

    def __init__(self, arm: ArmConfig, around: ArmContext) -> None:
        super().__init__(arm, around)
        self._commands.rows.update({row.name: self._row(row) for row in arm.commands})
        for name in self.states:
            if name in set(ArmState) or len(name.encode()) > MAX_NAME:
                raise ValueError(f"{name} cannot be a new state: every arm has it, or it is longer than "
                                 f"{MAX_NAME} bytes")
        self._own, self._guarded = {name: made(self) for name, made in self.states.items()}, Guarded(self)
        self._stages[ArmState.OWN] = self._guarded

    def _row(self, command: UserCommand) -> ArmCommandRow:
        if command.name in {row.name for row in COMMANDS["arm"]}:
            raise ValueError(f"{command.name} is a command of every arm; it needs another name")
        handler = handler_of(self, self.control.arm.name, command)

        def do(request: Request) -> str | None:
            try:
                answer: Any = handler(*arguments_of(command, request.values, request.text))
            except ValueError as why:
                raise CommandRefused(str(why)) from None
            return None if answer is None else str(answer)

        needs_homed = command_row(command).effect >= FREE and not command.stops
        return ArmCommandRow(do, Ready.JOINT if needs_homed else Ready.ALWAYS)

    # for use by derived classes

    def begin(self, name: str) -> None:
        """From HOMED to a user state; CommandRefused if the arm is not HOMED."""
        control = self.control
        if self.state is not ArmState.HOMED:
            raise CommandRefused(f"it is in {self.machine.sub_state} and must be in {ArmState.HOMED}")
        self._guarded.inner = self._own[name]
        control.stop(control.here, Mode.POSITION, f"the arm went to {name}")
        self.machine.begin_own(name)

    def end(self) -> None:
        """From a user state back to HOMED, holding at the present target; no effect in other states."""
        if self.state is ArmState.OWN:
            control = self.control
            control.stop(control.here, Mode.POSITION, f"{self.machine.sub_state} has ended")
            self.machine.fire(ArmEvent.ENDED)

    def follow(self, joints: ArrayLike) -> None:
        """Go to joints (size,), rad or m, in this cycle, within their limits; CommandRefused for a jump."""
        self._take(joints)
        self.control.streams.interrupt()
        self.control.follow(self.machine.sub_state, Space.JOINT)

    def move(self, joints: ArrayLike) -> None:
        """Move to joints (size,), at the speed of moves; `is_moving` until arrival. CommandRefused: not possible."""
        control = self.control
        self._take(joints)
        control.joints.clip(control.goal, control.here)
        reason = control.motion.move(control.goal, control.io.velocity, control.now_ns)
        if reason:
            raise CommandRefused(reason)

    def _take(self, joints: ArrayLike) -> None:
        goal, given = self.control.goal, np.asarray(joints, dtype=np.float64)
        if given.shape != goal.shape or not np.isfinite(given).all():
            space = self.control.joints
            names = ", ".join(f"{space.name(axis)} ({space.unit(axis)})" for axis in range(len(goal)))
            raise CommandRefused(f"{given.tolist()}: follow and move take {len(goal)} finite joints: {names}")
        goal[...] = given

    @property
    def is_moving(self) -> bool:
        """Whether a `move` is in progress."""
        return self.control.motion.moving or self.control.motion.jaw_moves


class DerivedPsm(DerivedArm, PsmLogic):
    """Base class for `type: PSM_DERIVED`."""


class DerivedEcm(DerivedArm, EcmLogic):
    """Base class for `type: ECM_DERIVED`."""


class DerivedMtm(DerivedArm, MtmLogic):
    """Base class for `type: MTM_DERIVED`."""
