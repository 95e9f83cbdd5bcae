"""Outputs that go high when nobody drives their robot any more.

One of them switches the lift of a Classic cart's setup joints off: a lift that moves must not go on when the process
that moves it has died.
"""

from __future__ import annotations

from typing import Final

from procs.io.bus.port import PortError
from procs.io.digital_outputs import DigitalOutputs
from procs.io.record import IoRecord
from procs.io.reports import IoReports
from procs.io.robots import Robots

WRITES: Final = 3  # a datagram may be lost


class IdleOutputs:
    """Those of one io."""

    def __init__(self, robots: Robots, record: IoRecord, outputs: DigitalOutputs, reports: IoReports) -> None:
        """`DigitalOutput.high_when_idle` names the robot."""
        self._robots, self._record, self._outputs, self._reports = robots, record, outputs, reports
        self._places = [(place, robots.names.index(row.high_when_idle))
                        for place, row in enumerate(robots.io.digital_outputs) if row.high_when_idle]
        self._writes = [WRITES] * len(self._places)  # at start: what a predecessor drove rests

    def step(self) -> None:
        """Once a cycle, also after a bad read."""
        record = self._record
        for number, (place, robot) in enumerate(self._places):
            if record.pid_enabled[robot] and not record.holding[robot]:
                self._writes[number] = WRITES
            elif self._writes[number]:
                self._writes[number] -= 1
                self._write(place, robot)

    def shutdown(self) -> None:
        """All rest."""
        for place, robot in self._places:
            for _ in range(WRITES):
                self._write(place, robot)

    def _write(self, place: int, robot: int) -> None:
        try:
            self._outputs.set(place, True)
        except PortError as error:
            self._reports.status(f"{self._outputs.names[place]}: {error}", self._robots.names[robot])
