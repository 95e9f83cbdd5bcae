"""How far axes may move that only brakes hold, in tests of single motors and brakes (`trocar commission`)."""

from __future__ import annotations

from typing import Final

import numpy as np

from trocar.procs.io.record import Flags, Floats
from trocar.procs.io.robots import IoData

ROOM_RAD, ROOM_M = 0.35, 0.05


class Room:
    """The room of all axes, and the condition of a test: the robot's power is on, its joint controller off."""

    def __init__(self, data: IoData) -> None:
        self._robots, self._samples, self._record = data.robots, data.samples, data.record
        self.slides: Final[Flags] = np.array([a.joint_type == "PRISMATIC" for a in data.robots.actuators], dtype=bool)
        self._most = np.where(self.slides, ROOM_M, ROOM_RAD)

    def start(self, robot: int) -> Floats:
        """The positions of a robot's axes now."""
        return self._samples.position[self._robots.slices[robot]].copy()

    def moved(self, robot: int, start: Floats) -> Floats:
        """How far a robot's axes have moved since."""
        return self._samples.position[self._robots.slices[robot]] - start

    def is_over(self, robot: int, moved: Floats) -> Flags:
        """Which axes of a robot have moved too far."""
        return np.abs(moved) > self._most[self._robots.slices[robot]]

    def may_test(self, robot: int) -> bool:
        """Whether power is on, and the joint controller off."""
        record = self._record
        return bool(record.amps_on[robot] and record.power_requested[robot] and not record.pid_enabled[robot])
