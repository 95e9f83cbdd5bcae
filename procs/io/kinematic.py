"""KINEMATIC robots: no boards, no motors; every actuator follows its setpoint at once and exactly.

Commands, power states, setpoints and their freshness, limits and generations are those of real robots, and so is the
record; it shows `simulated`, and values that only hardware could measure (currents, temperatures, potentiometers, board
time) are NaN. Differences, as in the reference:

    power_on      takes effect at once, also on the joint controller, at position 0 and without tracking check
    position      the setpoint after its limits; it stays where the joint controller is off or passes efforts through
    velocity      step of the setpoint over the time between its stamps, 0 when the newest is 20 ms old
    effort        0: there are no motors
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np

from trocar.procs.io.assemble import IoContext, kinematic
from trocar.procs.io.commands import IoCommands
from trocar.procs.io.fault_handler import FaultHandler
from trocar.procs.io.halves import track
from trocar.procs.io.record import Flags, Floats, IoRecord
from trocar.procs.node.requests import Request

MOVING_NS: Final = 20_000_000  # without a newer setpoint for this long, nothing moves


class KinematicIo:
    """Replaces `RobotIo` for robots without boards; the caller empties `reports.events` after each cycle."""

    def __init__(self, context: IoContext) -> None:
        """See `kinematic`."""
        self.io, self._now_ns = context.io, context.now_ns
        self.parts = parts = kinematic(context)
        self.robots, self.record, self.reports = parts.robots, parts.record, parts.reports
        self.pid, self.follow, self.desired = parts.pid, parts.follow, parts.desired
        robots, record, now_ns = parts.robots, parts.record, context.now_ns
        _show_what_is_not_there(record)
        self._track, _ = track(parts)
        self._commands, self._fault_handler = IoCommands(parts), FaultHandler(parts)
        places = {follower.robot: follower.place for follower in self.follow.followers}
        self._followed = [(place, robot, robots.slices[robot]) for robot, place in sorted(places.items())]
        self._stamps_ns, self._moves = [0] * len(robots.names), [False] * len(robots.names)
        record.velocity[...] = 0.0
        self._step: Floats = np.zeros(robots.axes)
        self._driven: Flags = np.zeros(robots.axes, dtype=bool)
        self._cycles = 0
        self.good = True  # every cycle has a sample
        self.stamp_ns = now_ns()
        """When the newest cycle began: the stamp of the record."""
        for name in robots.names:
            self.reports.status("KINEMATIC: no boards, no motors; positions follow the setpoints exactly", name)

    def cycle(self, commands: Iterable[Request] = ()) -> None:
        """One cycle; the caller publishes the record afterwards, and has numpy ignore NaN and infinite values."""
        now_ns = self.stamp_ns = self._now_ns()
        record, reports = self.record, self.reports
        news = self._track(now_ns)
        if news & ~self.follow.desired_bit:
            self.follow.receive(now_ns, news)
        self.desired.has_news = news >= self.follow.desired_bit and self.desired.are_new()
        self._commands.execute(commands, now_ns)
        if reports.trips:
            self._fault_handler.act(now_ns)
        self._commands.answer()
        self._move(now_ns)
        self.pid.control(record.position, record.velocity)
        self._cycles += 1
        record.cycle[...] = self._cycles
        record.read_ns[...] = record.recv_ns[...] = now_ns
        record.write_ns[...] = self._now_ns()

    def _move(self, now_ns: int) -> None:
        """Put actuators that follow positions at their setpoints."""
        record, pid, step = self.record, self.pid, self._step
        np.greater(pid.enabled, pid.effort_mode, out=self._driven)
        step.fill(0.0)
        np.subtract(pid.setpoint_position, record.position, out=step, where=self._driven)
        np.copyto(record.position, pid.setpoint_position, where=self._driven)
        stamps, enabled, anything = self.follow.taken_ns.tolist(), record.pid_enabled.tolist(), step.any()
        for place, robot, axes in self._followed:
            stamp_ns = stamps[place]
            since_ns = stamp_ns - self._stamps_ns[robot]
            self._stamps_ns[robot] = stamp_ns
            if anything and since_ns > 0 and enabled[robot] and now_ns - stamp_ns <= MOVING_NS:
                np.multiply(step[axes], 1e9 / since_ns, record.velocity[axes])
                self._moves[robot] = True
            elif self._moves[robot] and (since_ns > 0 or not enabled[robot] or now_ns - stamp_ns > MOVING_NS):
                record.velocity[axes] = 0.0
                self._moves[robot] = False

    def want(self, wanted: int) -> None:
        """No effect: no values are computed on demand."""

    def shutdown(self) -> None:
        """Mark everything as off in the record. Runs on every path out."""
        now_ns = self._now_ns()
        for robot in range(len(self.robots.names)):
            self.follow.enable(robot, False, now_ns)
            self.parts.power.off(robot)


def _show_what_is_not_there(record: IoRecord) -> None:
    """Set values that no sensor measures to NaN."""
    record.valid[...] = record.robot_valid[...] = True
    record.simulated[...] = record.biased[...] = record.encoder_set[...] = True
    for field in (record.firmware_velocity, record.software_velocity, record.acceleration, record.pot_position,
                  record.pot_voltage, record.current, record.current_request, record.temperature, record.board_period):
        field[...] = np.nan
