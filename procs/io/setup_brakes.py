"""Brakes of the setup joints that carry an Si arm: let go while a clutch button is pressed and the arm has power.

Their buttons and their brake hang on the controllers of the arm, by the names of the original's files: NAME_SUJ_clutch,
NAME_SUJ_clutch_2 and NAME_SUJ_brake (high: let go). I/O does it by itself, on the buttons as they are: a brake that a
process asked for would stay let go when that process dies.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from procs.io.bus.port import PortError
from procs.io.digital_outputs import DigitalOutputs
from procs.io.record import Flags, IoRecord
from procs.io.reports import IoReports
from procs.io.robots import Robots

BUTTONS: Final = ("SUJ_clutch", "SUJ_clutch_2")
BRAKE: Final = "SUJ_brake"
WRITES: Final = 3  # of each change: a datagram may be lost


@dataclass(slots=True)
class SetupBrake:
    """The brake under one arm; `inputs` and `output` are places in the record."""

    robot: int
    inputs: Flags
    output: int
    let_go: bool = False
    pressed: bool = False
    writes: int = WRITES  # at start: what a predecessor left let go holds


class SetupBrakes:
    """Those of all arms of one io."""

    def __init__(self, robots: Robots, record: IoRecord, outputs: DigitalOutputs, reports: IoReports) -> None:
        self._robots, self._record, self._outputs, self._reports = robots, record, outputs, reports
        buttons = [i.name for i in robots.io.digital_inputs]
        self._brakes = []
        for robot, name in enumerate(robots.names):
            inputs = np.isin(buttons, [f"{name}_{end}" for end in BUTTONS])
            if inputs.any() and f"{name}_{BRAKE}" in outputs.names:
                self._brakes.append(SetupBrake(robot, inputs, outputs.names.index(f"{name}_{BRAKE}")))

    def step(self) -> None:
        """Once a cycle, also after a bad read: what has lost its power holds."""
        for brake in self._brakes:
            self._follow(brake)

    def _follow(self, brake: SetupBrake) -> None:
        record, robot = self._record, brake.robot
        pressed = bool(record.input[brake.inputs].any())
        let_go = pressed and bool(record.amps_on[robot])
        if pressed and not brake.pressed and not let_go:
            self._reports.status("the arm needs power before the brakes of its setup joints let go",
                                 self._robots.names[robot])
        brake.pressed = pressed
        if let_go != brake.let_go:
            brake.let_go, brake.writes = let_go, WRITES
            self._reports.status(f"brakes of the setup joints {'let go' if let_go else 'hold'}",
                                 self._robots.names[robot])
        if brake.writes:
            brake.writes -= 1
            self._write(brake)

    def shutdown(self) -> None:
        """All hold."""
        for brake in self._brakes:
            brake.let_go = False
            for _ in range(WRITES):
                self._write(brake)

    def _write(self, brake: SetupBrake) -> None:
        try:
            self._outputs.set(brake.output, brake.let_go)
        except PortError as error:
            self._reports.status(f"brakes of the setup joints: {error}", self._robots.names[brake.robot])
