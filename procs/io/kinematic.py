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

from collections.abc import Callable, Iterable, Sequence
from typing import Final

import numpy as np

from trocar.procs.document.system import IoConfig
from trocar.procs.io.arm_requests import ArmRequests, DesiredCommand
from trocar.procs.io.brakes import Brakes
from trocar.procs.io.commands import IoCommands
from trocar.procs.io.devices import Devices
from trocar.procs.io.fault_handler import FaultHandler
from trocar.procs.io.gains import JointGains, configured_gains
from trocar.procs.io.halves import track
from trocar.procs.io.pid import Pid
from trocar.procs.io.power import KinematicPower
from trocar.procs.io.record import Field, Flags, Floats, IoRecord
from trocar.procs.io.reports import IoReports
from trocar.procs.io.robots import Robots
from trocar.procs.io.setpoint_rings import RingSource
from trocar.procs.io.setpoint_tracker import SetpointTracker
from trocar.procs.node.requests import Request
from trocar.shm.mailbox.generations import NoFaults, OwnCell

MOVING_NS: Final = 20_000_000  # without a newer setpoint for this long, nothing moves


class KinematicIo:
    """Replaces `RobotIo` for robots without boards; the caller empties `reports.events` after each cycle."""

    def __init__(self, io: IoConfig, now_ns: Callable[[], int], record: IoRecord, sources: Sequence[RingSource], *,
                 gains: Field | None = None, cells: Sequence[OwnCell] = (),
                 report: Callable[[DesiredCommand, str, str], None] | None = None) -> None:
        """`sources` in the order of `io.pids`, `cells` of `io.robots`; `report` gets the outcomes of arms' desired
        states.

        The robots start at the positions a previous process left in `record`.
        """
        self.io, self.record, self.reports = io, record, IoReports()
        self._now_ns = now_ns
        self.robots = robots = Robots(io)
        before = np.where(np.isfinite(record.position), record.position, 0.0)
        record.restart()
        record.position[...] = before
        _show_what_is_not_there(record)
        self.pid = Pid(configured_gains(io, robots), robots.maximum_effort, io.period_s, arrays=(
            record.setpoint_position, record.setpoint_velocity, record.setpoint_effort, record.position_error,
            record.disturbance, record.effort_mode))
        self.gains = JointGains(robots, record, self.pid, self.reports, gains)
        self.follow = SetpointTracker(io, robots, record, self.pid, record, self.reports, sources)
        self._power = KinematicPower(robots, record, self.reports, self.follow, self.pid)
        self.desired = ArmRequests(robots, record, self.follow, report)
        self._track, _ = track(self)
        devices = Devices(robots, record, self.reports, self.follow, self.pid, self._power, Brakes(robots, record),
                          self.desired, cells or [NoFaults() for _ in robots.names])
        self._commands, self._fault_handler = IoCommands(devices), FaultHandler(devices)
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
            self._power.off(robot)


def _show_what_is_not_there(record: IoRecord) -> None:
    """Set values that no sensor measures to NaN."""
    record.valid[...] = record.robot_valid[...] = True
    record.simulated[...] = record.biased[...] = record.encoder_set[...] = True
    for field in (record.firmware_velocity, record.software_velocity, record.acceleration, record.pot_position,
                  record.pot_voltage, record.current, record.current_request, record.temperature, record.board_period):
        field[...] = np.nan
