"""After a sterile adapter or an instrument was attached: the discs turn to and fro until it engages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

from trocar.procs.arm.motion import Mode
from trocar.procs.arm.stages.homing import Driving
from trocar.procs.arm.states import ArmEvent
from trocar.procs.kinematics.poses import Array
from trocar.procs.tables import codes

if TYPE_CHECKING:
    from trocar.procs.arm.arm import ArmLogic


class Engaging(Driving):
    """One move to each goal; the first goal is the start of the turning."""

    def __init__(self, arm: ArmLogic, what: str, goals: Callable[[], Sequence[Array]], still: Callable[[], bool],
                 caught: Callable[[], None]) -> None:
        """`goals` (size,) each; `still`: attached and not engaged; `caught` is called at the end."""
        super().__init__(arm)
        self._what, self._plan, self._still, self._caught = what, goals, still, caught
        self._goals: Sequence[Array] = ()
        self._next = 0

    def enter(self) -> None:
        control = self.control
        control.stop(control.here, Mode.POSITION, f"the {self._what} is being engaged")
        super().enter()

    def run(self) -> None:
        if self._still():
            super().run()
        else:
            self.control.status(f"the {self._what} is no longer to be engaged")
            self.control.machine.fire(ArmEvent.ENGAGED)

    def begin(self) -> None:
        self._goals, self._next = self._plan(), 0
        self._go_on()

    def drive(self) -> None:
        if self.control.motion.moving:
            return
        if self._next < len(self._goals):
            self.control.status(f"engaging {self._what} {self._next} of {len(self._goals) - 1}")
            self._go_on()
        else:
            self._caught()
            self.control.machine.fire(ArmEvent.ENGAGED)

    def _go_on(self) -> None:
        control = self.control
        reason = control.motion.move(self._goals[self._next], control.io.velocity, control.now_ns)
        self._next += 1
        if reason:
            self.fail(codes.ENGAGING_PLAN, f"engaging {self._what}: {reason}")
