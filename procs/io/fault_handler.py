"""io's reaction to the faults of a cycle: switch off the devices they require, latch the first of each robot, report.
"""

from __future__ import annotations

from trocar.procs.io.assemble import Parts
from trocar.procs.io.reports import IoEvent, IoFaultReport
from trocar.procs.node import fault_report as faults
from trocar.procs.tables import codes
from trocar.procs.tables.code_row import CUT, JOINT, NOTHING, POWER_OFF
from trocar.shm.system.events import SEVERITIES


class FaultHandler:
    """Handles all trips of `reports`, one after the other; consequent trips are added to them."""

    def __init__(self, parts: Parts) -> None:
        self._parts, self._robots, self._reports = parts, parts.robots, parts.reports
        self._reported: list[set[tuple[int, int]]] = [set() for _ in parts.robots.names]
        """Number and axis of the faults reported for each robot since its latch was cleared."""

    def act(self, now_ns: int) -> None:
        """Handle all trips found so far."""
        trips, parts, record = self._reports.trips, self._parts, self._parts.record
        while trips:
            trip = trips.pop(0)
            robot, fault = trip.robot, trip.fault
            if not record.fault[robot]:
                self._reported[robot].clear()
            what = fault.number, trip.axis
            if fault.action == NOTHING or what not in self._reported[robot]:
                self._reported[robot].add(what)
                self._report(trip)
            if fault.action == NOTHING:
                continue
            if not record.fault[robot]:
                record.fault[robot] = fault.number
            parts.faults[robot].fault()
            parts.desired.void(robot)
            parts.follow.enable(robot, False, now_ns)
            parts.brakes.engage(robot)  # the axes the joint controller no longer holds
            if fault.action in (POWER_OFF, CUT):
                parts.bias.stop(robot)
                parts.power.off(robot, open_relays=fault.action == CUT)
                for other in self._robots.sharing(robot):
                    if record.power_requested[other]:
                        self._reports.trip(codes.SHARED_BOARD, other)

    def _report(self, trip: IoFaultReport) -> None:
        fault, robots, name = trip.fault, self._robots, self._robots.names[trip.robot]
        axis, boards, unit = "", trip.boards, fault.unit
        if trip.axis >= 0:
            drive = int(robots.of_robot[trip.robot][trip.axis])
            axis, boards = robots.titles[trip.robot][trip.axis], boards or faults.boards_of(robots.all[drive])
            unit = robots.unit(drive) if unit == JOINT else unit
        text = faults.sentence(faults.place(name, axis, boards), fault.cause,
                                faults.figures(fault, trip.value, trip.limit, unit), trip.detail)
        self._reports.events.append(IoEvent(
            SEVERITIES[fault.severity], text, fault.code, name, trip.axis, trip.value, trip.limit,
            boards[0] if boards else -1, fault.remedy_for(name)))
