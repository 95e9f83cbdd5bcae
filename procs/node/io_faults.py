"""The cause of a robot's fault in io, for the process that drives this robot: from io's record and its events."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trocar.procs.document.system import Actuator, Brake, IoConfig, RecordPlace
from trocar.procs.node.fault_report import FaultReport, axis_titles, boards_of, place, reported, sentence
from trocar.procs.node.inputs import Fields
from trocar.procs.tables import codes
from trocar.procs.tables.code_row import ERROR, Code
from trocar.procs.tables.codes import AMPLIFIER, ARM_LOST, FAULTS
from trocar.shm.ring.ring import RingReader

RECENT_NS = 200_000_000
HARMLESS = frozenset((0, ARM_LOST.number, *(fault.number for fault in FAULTS if fault.severity < ERROR)))
"""Numbers in io's record that are no fault for the process that drives the robot."""


def power_lost() -> FaultReport:
    """The report of a power loss without details."""
    return FaultReport(codes.POWER_LOST, "detected power loss (actuators)")


def newest(events: RingReader, code: Code | None, component: str, since_ns: int) -> np.void | None:
    """The newest event with this code and component since shortly before a record with this stamp."""
    return next((row for row in events.since(since_ns - RECENT_NS)[::-1]
                 if code and row["code"] == code.code.encode() and row["component"] == component.encode()), None)


def io_stalls(events: RingReader, io: str) -> Callable[[int], str]:
    """io's report of the stall after which it restarted; an io that crashed reports none."""
    def report(since_ns: int) -> str:
        row = newest(events, codes.HELD_UP, io, since_ns)
        return "" if row is None else str(row["text"].decode(errors="replace"))

    return report


def fault_reports(newest_ns: Callable[[], int], events: RingReader, robot: str) -> Callable[[int], FaultReport]:
    """io's newest report of a fault of `robot`, else the text of the fault table. `newest_ns`: stamp of its record.

    io reports its events before it publishes the record that shows the fault.
    """

    def report(number: int) -> FaultReport:
        known = reported(number)
        row = newest(events, known.code, robot, newest_ns())
        if row is None:
            return known
        return FaultReport(known.code, row["text"].decode(errors="replace"), int(row["axis"]), int(row["board"]),
                           float(row["value"]), float(row["limit"]))

    return report


def power_reports(field: Fields, document: IoConfig, at: RecordPlace) -> Callable[[], FaultReport]:
    """The report for a loss of power, from the amplifiers in io's record: a single one that is off is named."""
    robot, titles, places = at.robot, axis_titles(document)[at.row], at.drives
    drives: list[Actuator | Brake] = [*robot.actuators, *robot.brakes]
    enabled, on = field("amp_enabled"), field("amp_on")

    def report() -> FaultReport:
        wanted = [axis for axis, drive in enumerate(places) if enabled[drive]]
        off = [axis for axis in wanted if not on[places[axis]]]
        if not off or len(off) == len(wanted):  # the common supply
            return power_lost()
        boards = boards_of(drives[off[0]])
        also = f"also axis {', '.join(map(str, off[1:]))}" if off[1:] else ""
        text = sentence(place(robot.name, titles[off[0]], boards), AMPLIFIER.cause, also)
        return FaultReport(AMPLIFIER, text, off[0], boards[0] if boards else -1)

    return report
