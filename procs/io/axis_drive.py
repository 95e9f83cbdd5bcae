"""Drive one motor without the joint controller to identify the axis it moves: for commissioning (`trocar commission`).

    RISING      the current rises from 0 to the requested value; all other motors have none, brakes hold
    LETTING_GO  the brake of this axis alone releases, if requested; the current stays
    over        this axis has moved by `travel`, another axis by more than ROOM, the time is over, or a stop came

Meanwhile, only the brakes hold the arm. Afterwards the motor has no current, and the brakes hold.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from trocar.procs.io.brakes import Brakes
from trocar.procs.io.pid import Pid
from trocar.procs.io.record import Floats
from trocar.procs.io.robots import IoData
from trocar.procs.io.room import Room
from trocar.shm.mailbox.received import Request

MAX_SHARE: Final = 0.5  # of the motor's largest current
MAX_RISE_S: Final = 3.0
MAX_TRAVEL_RAD, MAX_TRAVEL_M = 0.2, 0.03
TRAVEL_S: Final = 0.5  # the travel takes no less time than this
FREE_S: Final = 1.0  # how long an axis has current after its brake has released


@dataclass(frozen=True, slots=True)
class AxisDriveOrder:
    """A test as it was requested; `release`: release the brake once there is current."""

    axis: int
    current_a: float
    rise_s: float
    travel: float
    release: bool


@dataclass(slots=True)
class AxisDriveRun:
    """One test; positions are those of all axes of the robot at its start."""

    order: AxisDriveOrder
    asker: Request
    begin_ns: int
    start: Floats
    end_ns: int
    free: bool = False  # its brake was released


class AxisDrive:
    """Tests of all robots, one at a time on each."""

    def __init__(self, data: IoData, pid: Pid, brakes: Brakes) -> None:
        self._robots, self._samples, self._pid, self._brakes = data.robots, data.samples, pid, brakes
        self._room = Room(data)
        self._most_travel = np.where(self._room.slides, MAX_TRAVEL_M, MAX_TRAVEL_RAD)
        self.running: dict[int, AxisDriveRun] = {}

    def objection(self, robot: int, order: AxisDriveOrder) -> str:
        """Why the test cannot run, or ""."""
        place, robots = self._robots.slices[robot].start + order.axis, self._robots
        most, furthest = MAX_SHARE * float(robots.maximum_current[place]), float(self._most_travel[place])
        if not (robots.has_encoder[place] and robots.effort_to_current[place] != 0.0 and most > 0.0):
            return f"axis {order.axis} has no motor with an encoder"
        for value, limit, what in ((abs(order.current_a), most, "A"), (order.rise_s, MAX_RISE_S, "s"),
                                   (order.travel, furthest, "travel")):
            if not 0.0 < value <= limit:
                return f"{what} {value:g}; allowed: above 0 up to {limit:g}"
        return "an axis is being driven" if robot in self.running else ""

    def begin(self, robot: int, order: AxisDriveOrder, asker: Request, now_ns: int) -> None:
        """Start."""
        self.running[robot] = AxisDriveRun(order, asker, now_ns, self._room.start(robot),
                                           now_ns + round(order.rise_s * 1e9))

    def stop(self, robot: int, why: str) -> None:
        """End the test."""
        test = self.running.pop(robot, None)
        if test is not None:
            self._end(robot, test)
            test.asker.fail(why)

    def step(self, now_ns: int) -> None:
        """Called with each good sample, before the joint controllers compute their efforts."""
        if self.running:
            for robot in list(self.running):
                self._advance(robot, self.running[robot], now_ns)

    def _advance(self, robot: int, test: AxisDriveRun, now_ns: int) -> None:
        order = test.order
        if not self._room.may_test(robot):
            self.stop(robot, "power went off, or the joint controller on")
            return
        moved = self._room.moved(robot, test.start)
        far = self._room.is_over(robot, moved)
        if far.any():
            self._finish(robot, test, f"axis {int(np.argmax(far))} moved too far; ")
        elif (abs(moved[order.axis]) >= order.travel
              or (now_ns >= test.end_ns and not self._let_go(robot, test, now_ns))):
            self._finish(robot, test)
        else:
            share = min(1.0, (now_ns - test.begin_ns) / round(order.rise_s * 1e9))
            place = self._robots.slices[robot].start + order.axis
            # above a certain speed less current, none at twice that speed: a fast axis coasts without current
            share *= min(1.0, max(0.0, 2.0 - abs(self._samples.velocity[place]) * TRAVEL_S / order.travel))
            self._pid.effort_when_off[place] = share * order.current_a / self._robots.effort_to_current[place]

    def _let_go(self, robot: int, test: AxisDriveRun, now_ns: int) -> bool:
        """Release the brake; False if not requested, or already done."""
        if not test.order.release or test.free:
            return False
        test.free = True
        test.end_ns = now_ns + round((self._brakes.release_one(robot, test.order.axis) + FREE_S) * 1e9)
        return True

    def _finish(self, robot: int, test: AxisDriveRun, what: str = "") -> None:
        axis = test.order.axis
        moved = self._room.moved(robot, test.start)[axis]
        del self.running[robot]
        self._end(robot, test)
        test.asker.done(f"{what}axis {axis} moved by {moved:.5g}")

    def _end(self, robot: int, test: AxisDriveRun) -> None:
        place = self._robots.slices[robot].start + test.order.axis
        self._pid.effort_when_off[place] = self._pid.effort[place] = 0.0  # also in a cycle without a sample
        if test.free:
            self._brakes.engage(robot)
