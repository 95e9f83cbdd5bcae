"""KINEMATIC robots: no boards, no motors; every actuator follows its setpoint at once and exactly.

To the rest of io, they are a port with one board per robot, and samples; no other code differs. Power, relays and
amplifiers are as commanded, encoders are always set, no sample is missed, and:

    power on      puts the joints to 0, as in the reference
    position      the setpoint after its limits; it stays where the joint controller is off or passes efforts through
    velocity      step of the setpoint over the time between its stamps, 0 when the newest is 20 ms old
    effort        0: there are no motors

Values that only sensors could measure (currents, temperatures, potentiometers, board time) are NaN in the record.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.fpga import blocks, registers
from trocar.procs.io.assemble import IoContext, Parts
from trocar.procs.io.bus.port import Port
from trocar.procs.io.cycle import RobotIo
from trocar.procs.io.halves import Halves, track
from trocar.procs.io.record import Flags, Floats
from trocar.procs.io.robots import Robots
from trocar.procs.native.bound import BoundStruct
from trocar.procs.native.io_fields import IO, KINEMATIC, STATUS
from trocar.procs.native.library import bind

MOVING_NS: Final = 20_000_000  # without a newer setpoint for this long, nothing moves
SWITCHED: Final = (
    (registers.CONTROL_POWER_MASK, registers.CONTROL_POWER_ON, registers.STATUS_POWER | registers.STATUS_MV_GOOD),
    (registers.CONTROL_RELAY_MASK, registers.CONTROL_RELAY_ON,
     registers.STATUS_RELAY | registers.STATUS_RELAY_FEEDBACK))
"""Bits of control words that command a state, that command it on, and bits of status words that show it."""


def kinematic_io(context: IoContext) -> RobotIo:
    """The io of KINEMATIC robots; they stay at the positions that a previous process left in the record."""
    robots = Robots(context.io)
    where = np.where(np.isfinite(context.record.position), context.record.position, 0.0)
    port = Port(robots.board_ids, context.now_ns, max(len(robot.actuators) for robot in context.io.robots))
    core = RobotIo(context, port, np.ones(robots.axes, dtype=bool), KinematicHalves)
    core.samples.position[...] = where
    for name in robots.names:
        core.reports.status("KINEMATIC: no boards, no motors; positions follow the setpoints exactly", name)
    return core


class KinematicHalves(Halves):
    """Both halves without encoding and decoding: samples and commands are passed as values."""

    MOVING_NS = MOVING_NS

    def __init__(self, parts: Parts, context: IoContext, uses: tuple[int, float, float]) -> None:
        """See `Halves`."""
        super().__init__(parts, context, uses, native=False)
        self.track, self.why_numpy = track(parts)
        self.robots, self.record, self.tracker = parts.robots, parts.record, parts.follow
        self.samples, self.pid, self.outputs = parts.samples, parts.pid, parts.outputs
        self.commanded = np.zeros(self.robots.board_count, np.uint32)
        self.stamps_ns: NDArray[np.int64] = np.zeros(self.robots.count, dtype=np.int64)
        self.moves: Flags = np.zeros(self.robots.count, dtype=bool)
        self.step: Floats = np.zeros(self.robots.axes)
        self._driven: Flags = np.zeros(self.robots.axes, dtype=bool)
        self._status = parts.port.blocks[:, blocks.STATUS]
        self._has_obeyed = False
        self.bound = bind(IO, parts)
        self._control: Callable[[float, int], object] = (
            self.bound.function("control_and_encode") if isinstance(self.bound, BoundStruct) else self._by_numpy)
        bound = bind(KINEMATIC, self) if isinstance(self.bound, BoundStruct) else ""
        self._follow: Callable[[int, int, int], int] | None = None
        """Both halves in a native call; None: there is none."""
        if isinstance(bound, BoundStruct):
            self.move, self._follow = (  # type: ignore[method-assign]
                bound.function(name) for name in KINEMATIC.functions)
        record = self.record
        record.simulated[...] = True
        for field in (record.firmware_velocity, record.software_velocity, record.acceleration, record.pot_position,
                      record.pot_voltage, record.current, record.current_request, record.temperature,
                      record.board_period):
            field[...] = np.nan

    def receive_and_check(self, good_ns: int, wake_ns: int, gap_ns: float) -> int:
        if self._follow is None or self._has_obeyed:
            return super().receive_and_check(good_ns, wake_ns, gap_ns)
        port = self._port
        port.read_all()
        bits = self._follow(port.recv_ns, wake_ns, self._over_ns())
        if bits:
            port.write_all()
        return bits

    def decode_and_check(self) -> int:
        """The bits of `receive_and_check`: positions are never too far from their setpoints, nor values too large."""
        self.move(self._port.recv_ns)
        if not self._has_obeyed:
            return 0
        self._has_obeyed = False
        return STATUS if self._power.watch() else 0

    def control_and_encode(self, share: float, has_sample: int) -> int:
        """Joint controllers, and the commands for power; efforts are in the record, and no motor takes them."""
        self._control(share, has_sample)
        self.record.current_request.fill(np.nan)
        if self.outputs.has_one_shot or self.outputs.control.tobytes() != self.commanded.tobytes():
            self._obey()
        return 0

    def _by_numpy(self, share: float, has_sample: int) -> None:
        self.pid.control(self.samples.position, self.samples.velocity)

    def show(self) -> int:
        """Fill the rest of the record; there are no inputs."""
        self.record.position[...] = self.samples.position
        return 0

    def move(self, now_ns: int) -> int:
        """Put actuators that follow positions at their setpoints."""
        position, velocity, pid, step = self.samples.position, self.samples.velocity, self.pid, self.step
        np.greater(pid.enabled, pid.effort_mode, out=self._driven)
        step.fill(0.0)
        np.subtract(pid.setpoint_position, position, out=step, where=self._driven)
        np.copyto(position, pid.setpoint_position, where=self._driven)
        anything = step.any()
        for follower in self.tracker.followers:
            robot, axes, stamp_ns = follower.robot, follower.axes, int(self.tracker.taken_ns[follower.place])
            since_ns = stamp_ns - int(self.stamps_ns[robot])
            is_moved = self.record.pid_enabled[robot] and now_ns - stamp_ns <= MOVING_NS
            self.stamps_ns[robot] = stamp_ns
            if anything and since_ns > 0 and is_moved:
                np.multiply(step[axes], 1e9 / since_ns, velocity[axes])
                self.moves[robot] = True
            elif self.moves[robot] and (since_ns > 0 or not is_moved):
                velocity[axes] = 0.0
                self.moves[robot] = False
        return 0

    def _obey(self) -> None:
        """Power, relays and amplifiers as commanded; joints are at 0 when they get power."""
        robots, status, samples, control = self.robots, self._status, self.samples, self.outputs.control
        self.commanded[...], self._has_obeyed = control, True
        had_power = status & registers.STATUS_POWER != 0
        for mask, on, shown in SWITCHED:
            status[control & mask != 0] &= ~np.uint32(shown)
            status[control & on == on] |= np.uint32(shown)
        has_power = status & registers.STATUS_POWER != 0
        samples.position[(has_power & ~had_power)[robots.board_row[: robots.axes]]] = 0.0
        np.logical_and(self.record.amp_enabled, has_power[robots.board_row], self.record.amp_on)
        samples.amp_on[...] = self.record.amp_on
