"""An operator's hand and foot on emulated boards: a console's pedal, a master's gripper, and its tip."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.system import from_json
from trocar.shm.mailbox.client import MailboxFull
from trocar.shm.memory.closable import Closable
from trocar.shm.system import directory
from trocar.shm.time.clock import pause
from trocar.shm.time.system_time import Patience
from trocar.tools.client.remote import Remote
from trocar.tools.examples.operator_sim import OperatorSim, SeenRecord, SimTeleop
from trocar.tools.output.errors import Problem

Array = NDArray[np.float64]

PINCH = 0.8  # rad; teleoperations require 40°
FIRMLY = (500.0, 1.5)  # N/m, N·m/rad of a guiding hand
BEATS_S = 0.01
FOLLOWS_S = 25.0
PINCHED_NS = 1_000_000_000
WAITS_FOR_PINCH = "waiting: pinch or twist"


def figure_eight(angle: float, size_m: float) -> Array:
    """Where on a lying eight, `size_m` to each side, from its middle (3,), m."""
    return size_m * np.array((math.sin(angle), 0.5 * math.sin(2.0 * angle), 0.0))


class Hand(Closable):
    """A hand at the master of a teleoperation; a context manager that releases it.

    It acts on one operator's command that enables teleoperation. If following ends except by the clutch, or a fault
    occurs, it releases master and pedals, and does nothing until such a command is given again, or another foot presses
    the pedal while teleoperation is enabled.
    """

    def __init__(self, system: str, seat: OperatorSim, teleop: SimTeleop) -> None:
        document = from_json(directory.document(system))
        self._system = system
        self._seat, self._teleop, self.master = seat, teleop, teleop.masters[0]
        self._gripper = document.arm(self.master).gripper
        row = next(console for console in document.consoles if console.name == seat.console.name)
        self._pedals = [wired.name for wired in row.operator_present]
        self._boards = Remote(system, "boards")
        self._seen = SeenRecord(system, self.master, "arm")
        self._asked = 0
        """Number of the command it works on."""
        self._at_work = self._has_followed = self._at_pedals = self._holds = self._is_present = False
        self._opened: float | None = None
        """The gripper's angle before it was pinched; None: it is not."""
        self._pinch_ns = 0
        self.place = np.zeros(7)

    def begin(self) -> None:
        """Enable teleoperation, press the pedal, wait for the alignment, pinch; then the teleoperation follows.

        Problem names the unmet condition.
        """
        self._seat.ask("teleop_enable", 1)
        with Patience(self._system, FOLLOWS_S) as patience:
            while not self.follows():
                if patience.is_over:
                    raise Problem(f"after {FOLLOWS_S:g} s {self._teleop.reported}")
                pause(BEATS_S)

    def follows(self) -> bool:
        """Meet the conditions for following, once a beat: the pedals, a pinch; returns whether it follows."""
        follows = self._look()
        at_work = self._at_work
        if at_work is not self._at_pedals:
            pressed = all(self._post("press", (float(at_work),), pedal) for pedal in self._pedals)
            self._at_pedals = at_work if pressed else self._at_pedals
        pinches = at_work and not follows and str(self._teleop.value("reason")).startswith(WAITS_FOR_PINCH)
        if self._teleop.ring.stamp_ns >= self._pinch_ns if pinches else self._opened is not None:
            self._toggle()
        return follows

    def _look(self) -> bool:
        """Whether there is a command to work on; returns whether it follows by it."""
        console, follows = self._seat.console, self._teleop.is_following
        asked = int(console.value("origin")) if console.value("teleop_enabled") else 0
        was_present, self._is_present = self._is_present, bool(console.value("operator_present"))
        by_another_foot = self._is_present and not (was_present or self._at_pedals)
        if asked != self._asked or by_another_foot:
            self._asked, self._at_work, self._has_followed = asked, asked != 0, False
        self._has_followed |= follows
        # behind a clutch the teleoperation still knows that the master is held by hand
        self._at_work &= follows or not self._has_followed or bool(self._teleop.value("operator_active"))
        return follows and self._at_work

    def _toggle(self) -> None:
        """Pinch the gripper, or open it again."""
        angle = float(self._seen.value("gripper_position")) - PINCH if self._opened is None else self._opened
        if self._post("set_position", (angle,), self._gripper):
            self._opened = angle + PINCH if self._opened is None else None
            self._pinch_ns = self._teleop.ring.stamp_ns + PINCHED_NS

    def holds(self) -> bool:
        """Hold the tip while it follows, release it otherwise; True: it was held before, too."""
        follows, held = self.follows(), self._holds
        if follows and not held:
            self.take()
        elif held and not follows:
            self._holds = not self._post("release_tip", (), self.master)
        return held and self._holds

    def take(self) -> None:
        """Hold the tip firmly at its position."""
        self.place = np.array(self._seen.value("local_measured_cp"))
        self._holds = self._post("pull_tip", (*self.place, *FIRMLY), self.master)

    def draw(self, offset: Array) -> None:
        """Pull the tip to `offset` (3,) m, in the axes of the master's base, from the position where it was taken."""
        pose = self.place.copy()
        pose[:3] += offset
        self._post("pull_tip", pose, self.master)

    def nudge(self, actuators: Array) -> None:
        """Move the master's actuators (7,) at once."""
        self._post("set_position", actuators, self.master)

    def _post(self, command: str, values: Sequence[float] | Array, text: str) -> bool:
        """False: the boards, which may just be started again, have no room for it; it is tried again a beat later."""
        self._boards.replies()
        try:
            self._boards.send(command, values, text)
        except MailboxFull:
            return False
        return True

    def close(self) -> None:
        """Release the tip and the pedals."""
        self._post("release_tip", (), self.master)
        for pedal in self._pedals:
            self._post("press", (0.0,), pedal)
        self._boards.close()
        self._seen.ring.close()
