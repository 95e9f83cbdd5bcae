"""What io does about the faults of a cycle: switch off what they ask for, latch the first of each robot, tell."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from trocar.procs.io.arm_requests import ArmRequests
from trocar.procs.io.brakes import Brakes
from trocar.procs.io.devices import BiasDevice, PowerDevice
from trocar.procs.io.record import IoRecord
from trocar.procs.io.reports import IoEvent, IoFaultReport, IoReports
from trocar.procs.io.robots import Robots
from trocar.procs.io.setpoint_tracker import SetpointTracker
from trocar.procs.node import fault_report as faults
from trocar.procs.tables import codes
from trocar.shm.mailbox.generations import OwnCell
from trocar.shm.system.events import SEVERITIES

POWERING: Final = (codes.POWER_TIMEOUT, codes.AMPLIFIER)
"""Not faults of a robot that has power: whoever asked for it may try once more."""


class FaultHandler:
    """All trips of `reports`, one after the other; what they bring about is added to them."""

    def __init__(self, robots: Robots, record: IoRecord, reports: IoReports, follow: SetpointTracker,
                 power: PowerDevice, bias: BiasDevice,
                 brakes: Brakes, cells: Sequence[OwnCell], desired: ArmRequests) -> None:
        """`cells` of every robot, which say since when commands count."""
        self._robots, self._record, self._reports, self._follow = robots, record, reports, follow
        self._power, self._bias, self._brakes, self._cells = power, bias, brakes, cells
        self._desired = desired
        self._reported: list[set[tuple[int, int]]] = [set() for _ in robots.names]
        """Number and axis of what was reported of each robot since its latch was cleared."""

    def act(self, now_ns: int) -> None:
        """On everything found so far."""
        trips = self._reports.trips
        while trips:
            trip = trips.pop(0)
            robot, fault, record = trip.robot, trip.fault, self._record
            if not record.fault[robot]:
                self._reported[robot].clear()
            what = fault.number, trip.axis
            if fault.action == codes.NOTHING or what not in self._reported[robot]:
                self._reported[robot].add(what)
                self._report(trip)
            if fault.action == codes.NOTHING:
                continue
            if not record.fault[robot]:
                record.fault[robot] = fault.number
            if self._power.reached[robot] or fault not in POWERING:
                self._cells[robot].fault()
            self._desired.void(robot)
            self._follow.enable(robot, False, now_ns)
            self._brakes.engage(robot)  # what the joint controller no longer holds
            if fault.action in (codes.POWER_OFF, codes.CUT):
                self._bias.stop(robot)
                self._power.off(robot, open_relays=fault.action == codes.CUT)
                for other in self._robots.sharing(robot):
                    if record.power_requested[other]:
                        self._reports.trip(codes.SHARED_BOARD, other)

    def _report(self, trip: IoFaultReport) -> None:
        fault, robots, name = trip.fault, self._robots, self._robots.names[trip.robot]
        axis, boards, unit = "", trip.boards, fault.unit
        if trip.axis >= 0:
            drive = int(robots.of_robot[trip.robot][trip.axis])
            axis, boards = robots.titles[trip.robot][trip.axis], boards or faults.boards_of(robots.all[drive])
            unit = robots.unit(drive) if unit == codes.JOINT else unit
        text = faults.sentence(faults.place(name, axis, boards), fault.cause,
                                faults.figures(fault, trip.value, trip.limit, unit), trip.detail)
        self._reports.events.append(IoEvent(
            SEVERITIES[fault.severity], text, fault.code, name, trip.axis, trip.value, trip.limit,
            boards[0] if boards else -1, fault.remedy_for(name)))
