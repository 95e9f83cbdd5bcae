"""An operator's hand and foot at emulated boards: a console's pedal, a master's gripper, and its tip."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from procs.document.system import from_json
from shm import directory
from shm.clock import pause
from shm.system_time import Patience
from tools.errors import Problem
from tools.examples.operator_sim import OperatorSim, SeenRecord, SimTeleop
from tools.remote import Remote

Array = NDArray[np.float64]

PINCH = 0.8  # rad; teleoperations want to see 40° of it
FIRMLY = (500.0, 1.5)  # N/m, N·m/rad of a hand that guides
BEATS_S = 0.01
ALIGNED_S = 20.0
PINCHED_S = 5.0


def figure_eight(angle: float, size_m: float) -> Array:
    """Where on a lying eight, `size_m` to each side, from its middle (3,), m."""
    return size_m * np.array((math.sin(angle), 0.5 * math.sin(2.0 * angle), 0.0))


class Hand:
    """A hand at the master of a teleoperation; a context manager that lets go."""

    def __init__(self, system: str, seat: OperatorSim, teleop: SimTeleop) -> None:
        document = from_json(directory.document(system))
        self._system = system
        self._seat, self._teleop, self.master = seat, teleop, teleop.masters[0]
        self._gripper = document.arm(self.master).gripper
        row = next(console for console in document.consoles if console.name == seat.console.name)
        self._pedals = [wired.name for wired in row.operator_present]
        self._boards = Remote(system, "boards")
        self._seen = SeenRecord(system, self.master, "arm")
        self.place = np.zeros(7)

    def begin(self) -> None:
        """Want teleoperation, step on the pedal, wait for the alignment, pinch; the teleoperation follows then.

        Problem says what it waits for instead.
        """
        self._seat.ask("teleop_enable", 1)
        for pedal in self._pedals:
            self._boards.ask("press", (1.0,), pedal)
        self._until("pinch or twist", ALIGNED_S)
        angle = float(self._seen.value("gripper_position"))
        self._boards.ask("set_position", (angle - PINCH,), self._gripper)
        self._until("", PINCHED_S)
        self._boards.ask("set_position", (angle,), self._gripper)

    def take(self) -> None:
        """Hold the tip firmly where it is."""
        self.place = np.array(self._seen.value("local_measured_cp"))
        self._boards.ask("pull_tip", (*self.place, *FIRMLY), self.master)

    def draw(self, offset: Array) -> None:
        """Pull the tip to `offset` (3,) m, in the axes of the master's base, from where it was taken."""
        pose = self.place.copy()
        pose[:3] += offset
        self._boards.replies()
        self._boards.post("pull_tip", pose, self.master)

    def nudge(self, actuators: Array) -> None:
        """Put the master's actuators (7,) somewhere at once."""
        self._boards.replies()
        self._boards.post("set_position", actuators, self.master)

    def _until(self, reason: str, seconds: float) -> None:
        """Until that alone is waited for; "": until it follows."""
        with Patience(self._system, seconds) as patience:
            while not (self._teleop.is_following if not reason else self._is_next(reason)):
                if patience.is_over:
                    raise Problem(f"after {seconds:g} s {self._teleop.reported}")
                pause(BEATS_S)

    def _is_next(self, reason: str) -> bool:
        return self._teleop.is_following or str(self._teleop.value("reason")).startswith(f"waiting: {reason}")

    def close(self) -> None:
        """Let go, leave the pedals."""
        self._boards.post("release_tip", (), self.master)
        for pedal in self._pedals:
            self._boards.post("press", (0.0,), pedal)
        self._boards.close()
        self._seen.ring.close()

    def __enter__(self) -> Hand:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()
