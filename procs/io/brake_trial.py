"""Give the brake of one axis a chosen current, to find those that release and hold it (`trocar commission`).

The motors have no current. Each command lasts LASTS_NS; the brake engages then, and at once if any axis has moved by
more than ROOM since the first of a row of commands, power goes off, or the joint controller comes on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

from trocar.procs.io.brakes import Brakes
from trocar.procs.io.record import Floats
from trocar.procs.io.robots import IoData
from trocar.procs.io.room import Room

LASTS_NS: Final = 500_000_000


@dataclass(slots=True)
class BrakeTrial:
    """A row of commands: its axis, all positions at its start, the end of the newest."""

    axis: int
    start: Floats
    end_ns: int


class BrakeTrials:
    """Those of all robots, one at a time on each."""

    def __init__(self, data: IoData, brakes: Brakes) -> None:
        self._room, self._brakes = Room(data), brakes
        self.running: dict[int, BrakeTrial] = {}
        self._fallen: set[int] = set()  # robots with an axis that moved too far, until `stop`

    def give(self, robot: int, axis: int, current_a: float, now_ns: int) -> str:
        """Begin or extend a trial; returns the reason for a refusal, or ""."""
        trial = self.running.get(robot)
        if robot in self._fallen:
            return "an axis moved too far; brake_engage first"
        if trial is not None and trial.axis != axis:
            return f"brake {trial.axis} is being tried"
        if why := self._brakes.give(robot, axis, current_a):
            return why
        start = self._room.start(robot) if trial is None else trial.start
        self.running[robot] = BrakeTrial(axis, start, now_ns + LASTS_NS)
        return ""

    def step(self, now_ns: int) -> None:
        """Called with each good sample."""
        for robot, trial in list(self.running.items()):
            has_fallen = self._room.is_over(robot, self._room.moved(robot, trial.start)).any()
            if now_ns >= trial.end_ns or has_fallen or not self._room.may_test(robot):
                self.stop(robot)
                if has_fallen:
                    self._fallen.add(robot)

    def stop(self, robot: int) -> None:
        """Engage the brakes of a robot with a trial, and permit further ones."""
        self._fallen.discard(robot)
        if self.running.pop(robot, None) is not None:
            self._brakes.engage(robot)
