"""One I/O cycle: read → decide → control → write → publish, on plain arrays and the caller's clock.

A bad read is tolerated while the last good sample is younger than the watchdog time: the last outputs are written again
(the boards must see a living host), nothing is computed from old values, and the record shows `valid` = false and the
age of the values. An effort computed for one period would drive a light joint for many, so it fades out meanwhile.
After the watchdog time it is a fault: joint controllers and power go off.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.io.assemble import IoContext, Parts
from trocar.procs.io.bus.port import Port
from trocar.procs.io.fault_handler import FaultHandler
from trocar.procs.io.halves import Halves
from trocar.procs.io.io_commands import IoCommands
from trocar.procs.io.record import Flags
from trocar.procs.io.reports import also
from trocar.procs.io.start import restore
from trocar.procs.io.timing import Timing
from trocar.procs.native.io_fields import CONTROLLED, LIMIT, MISSED, NOT_FINITE, SENT, STATUS, TRACKING
from trocar.procs.tables import codes
from trocar.shm.mailbox.received import Request

DEFAULT_AGE_NS: Final = 30_000_000  # permitted age of a sample where the watchdog is switched off
MISSED_REPEAT_NS: Final = 1_000_000_000
STRANGER_REPEAT_NS: Final = 120_000_000_000
FADES_NS, FADED_NS = 3_000_000, 10_000_000
STABLE_NS: Final = 2_500_000  # efforts may stay this long, or PERIODS if longer: the stability limit of light joints
PERIODS: Final = 1.25
GAPS: Final = 8  # between samples: this many make the mean
FAREWELLS: Final = 3  # writes at shutdown: a datagram may be lost


def share_of(age_ns: int) -> float:
    """Share of efforts left at this age of their sample: all up to 3 ms, then less, none after 10 ms."""
    return min(1.0, max(0.0, (FADED_NS - age_ns) / (FADED_NS - FADES_NS)))


class RobotIo:
    """All of io except shared memory. The caller empties `reports.events` after each cycle."""

    def __init__(self, context: IoContext, port: Port, preset: Flags | None = None, halves: type[Halves] = Halves
                 ) -> None:
        """See `Parts`."""
        self.io, self._now_ns = context.io, context.now_ns
        self.parts = parts = Parts(context, port, preset)
        self.robots, self.record, self.reports, self.port = parts.robots, parts.record, parts.reports, port
        self.samples, self.pid, self.follow, self.power = parts.samples, parts.pid, parts.follow, parts.power
        self._commands, self._fault_handler = IoCommands(parts), FaultHandler(parts)
        io, robots, record, now_ns = context.io, parts.robots, parts.record, context.now_ns
        self._oldest_ns = round(io.watchdog_s * 1e9) or DEFAULT_AGE_NS
        self._good_ns = now_ns()
        self.stamp_ns = self._good_ns
        """When the newest sample arrived, or a bad read ended: the stamp of the record."""
        self.good = False
        """The last cycle had a complete fresh sample."""
        self._before_ns = self._good_ns
        period_ns = io.period_s * 1e9
        self._gap_ns, self._stable_ns = period_ns, max(STABLE_NS, PERIODS * period_ns)
        self.halves = halves(parts, context, (self._oldest_ns, float(self._stable_ns), float(GAPS)))
        self._missed_ns = -MISSED_REPEAT_NS
        self._lost = False
        self._away: Flags = np.zeros(len(port.board_ids), dtype=bool)
        self._no_robots, self._is_whole = self._away.tobytes(), False  # the record shows all robots as sampled
        self._lacking: Flags = np.zeros(len(robots.names), dtype=bool)  # robots with a board that is away
        self._whole_ns = self._good_ns
        """When every board was last sampled."""
        self._sampled_ns: NDArray[np.int64] = np.full(len(robots.names), self._good_ns, dtype=np.int64)
        """When all boards of each robot were last sampled."""
        self._cycles = 0
        self._shown = [cell.reshape(1).data for cell in (record.cycle, record.read_ns, record.recv_ns, record.write_ns,
                                                         record.age_ns)]
        self._timing = Timing(io.name, io.period_s, record, self.reports, self._good_ns)
        self._strays, self._stranger, self._stranger_ns = 0, "", -STRANGER_REPEAT_NS
        self._bad_by_board = port.counters.board_bad_reads.copy()
        record.calibration_mode[...] = io.calibration_mode
        if io.calibration_mode:
            self.reports.warn(codes.CALIBRATION_MODE, io.name)
        if port.assumed:
            self.reports.warn(codes.FIRMWARE_UNKNOWN, io.name, boards=port.assumed)

    def cycle(self, commands: Iterable[Request] = ()) -> None:
        """One cycle; the caller publishes the record afterwards, and has numpy ignore NaN and infinite values.

        `commands`: () for none. In steady state, nothing is done between the halves (procs/io/halves.py).
        """
        read_ns = self._now_ns()
        self.port.ask_all()
        # Setpoints are taken while the boards sample: that takes no time between read and write.
        news = self.halves.track(read_ns)
        if news & ~self.follow.desired_bit:
            self.follow.receive(read_ns, news)
        self.parts.desired.has_news = news >= self.follow.desired_bit and self.parts.desired.are_new()
        wake_ns = 0 if commands or self._is_busy() else self.power.wake_ns
        bits = self.halves.receive_and_check(self._good_ns, wake_ns, self._gap_ns)
        self.good = good = not bits & MISSED
        now_ns = self.stamp_ns = self.port.recv_ns if good else self._now_ns()
        if good:
            self._before_ns, self._good_ns = self._good_ns, now_ns
            self._gap_ns += (min(now_ns - self._before_ns, self._oldest_ns) - self._gap_ns) / GAPS
        is_done = bool(bits & CONTROLLED)  # the native library went on with the other half
        if not is_done and (bits or now_ns >= wake_ns or self.port.away.tobytes() != self._no_robots):
            self._decide(bits, commands, now_ns)
        else:
            self._whole_ns = now_ns
        if not bits & SENT:
            # new efforts will stay about as long as the previous ones: the longer, the smaller the share
            share = min(1.0, self._stable_ns / self._gap_ns)
            if not good:
                share *= share_of(now_ns - self._good_ns)
            bits |= self.halves.control_and_send(share, good and not is_done)
        if bits & NOT_FINITE:
            self._not_finite(now_ns)
        parts, has_outputs = self.parts, self.parts.digital_outputs.count
        if has_outputs:
            parts.setup_brakes.step(now_ns)
            parts.cart.step(now_ns)
        self._show(good, read_ns, now_ns)
        if has_outputs:
            parts.digital_outputs.step()
        if parts.instruments.running:
            parts.instruments.step(good, now_ns)

    def _is_busy(self) -> bool:
        """Whether something besides the sample can have an effect in this cycle."""
        parts, power, safety = self.parts, self.power, self.parts.safety
        return bool(not self._is_whole or self.port.away.tobytes() != self._no_robots or self.reports.trips
                    or parts.tasks or parts.desired.has_news or parts.outputs.has_one_shot or self._commands.waits
                    or power.changed or safety.counting or safety.set_encoder_zero or parts.brakes.busy
                    or parts.bias.running or parts.axis_drive.running or parts.brake_trials.running
                    or parts.watchdogs.busy)

    def _decide(self, bits: int, commands: Iterable[Request], now_ns: int) -> None:
        """What to do about the sample and the commands, before the joint controllers."""
        good = not bits & MISSED
        if good:
            self._look(bits, now_ns)
        else:
            self._missed(now_ns)
        self._show_validity(good, now_ns)
        self._commands.execute(commands, now_ns)
        if self.reports.trips:
            self._fault_handler.act(now_ns)
        self._commands.answer()  # only now: a fault in this cycle may have undone a command
        if not good:
            return
        if self.parts.tasks is not None:
            self.parts.tasks.step(now_ns)
        if bits & TRACKING or commands or self.parts.desired.has_news:  # which may have changed the tolerances
            self._judge_tracking()
        if self.reports.trips:
            self._fault_handler.act(now_ns)
        self.parts.axis_drive.step(now_ns)
        self.parts.brake_trials.step(now_ns)

    def _look(self, bits: int, now_ns: int) -> None:
        """Examine the news of a good sample."""
        if self._lost:
            self._lost = False
            self.reports.status("communication with the controllers restored")
            self._restore(~self.port.away, now_ns)
        power, safety = self.power, self.parts.safety
        if bits & STATUS or now_ns >= power.wake_ns:
            power.step(now_ns)
        is_beyond = bits & LIMIT
        if power.changed:
            power.changed = False
            safety.refresh(power.reached)
            is_beyond = safety.check()
        if is_beyond or safety.counting:
            safety.examine(now_ns)
        for robot in safety.set_encoder_zero:
            self.parts.bias.zero(robot)
        safety.set_encoder_zero.clear()
        for robot in power.not_preloaded:
            if not self.record.pid_enabled[robot]:  # else its amplifiers, now off, cause a fault first
                self.parts.bias.zero(robot)
        power.not_preloaded.clear()
        self.parts.brakes.step((now_ns - self._before_ns) * 1e-9)
        self.parts.bias.step()
        self.parts.watchdogs.step(now_ns)

    def _show_validity(self, good: bool, now_ns: int) -> None:
        """Show the robots sampled in this cycle; report and switch off those with a board that is away."""
        record, away = self.record, self.port.away
        if good and away.tobytes() == self._no_robots == self._away.tobytes():
            if not self._is_whole:
                self._is_whole = True
                record.valid[...] = record.robot_valid[...] = True
            self._whole_ns = now_ns
            return
        if self._is_whole:
            self._is_whole = False
            self._sampled_ns[...] = self._whole_ns
        if not good:
            record.valid[...] = record.robot_valid[...] = False
        else:
            if (away != self._away).any():
                self._who_is_away_changed(away)
            else:  # report again for a robot that was commanded to power on meanwhile
                for robot in np.flatnonzero(self._lacking & record.power_requested & (record.fault == 0)).tolist():
                    self._trip_away(robot)
            np.logical_not(self._lacking, record.robot_valid)
            record.valid[...] = not away.any()
            np.copyto(self._sampled_ns, now_ns, where=record.robot_valid)
            if not away.any():
                self._whole_ns = now_ns

    def _trip_away(self, robot: int) -> None:
        ids, lacks = self.robots.board_ids, self.robots.on_board[robot] & self._away
        self.reports.trip(codes.BOARD_AWAY, robot, boards=tuple(ids[row] for row in np.flatnonzero(lacks).tolist()))

    def _who_is_away_changed(self, away: Flags) -> None:
        """A board that left the bus is a fault of its robots only; a board that returned may be as after power-up."""
        robots, ids = self.robots, self.robots.board_ids
        left, back = away & ~self._away, self._away & ~away
        self._away[...] = away
        self._lacking[...] = (robots.on_board & away).any(axis=1)
        for robot, boards in enumerate(robots.on_board):
            if (boards & left).any():
                self._trip_away(robot)
        self._restore(back, self._now_ns())
        for row in np.flatnonzero(back).tolist():
            self.reports.status(f"board {ids[row]} is back", self.io.name)
        for row in np.flatnonzero(left & ~robots.on_board.any(axis=0)).tolist():  # it has only inputs and outputs
            self.reports.warn(codes.READ_MISSED, self.io.name, boards=(ids[row],))

    def _restore(self, boards: Flags, now_ns: int) -> None:
        """Restore the settings of boards that return, and forget the encoders that these have lost."""
        parts = self.parts
        parts.bias.forget(restore(self.robots, self.port, parts.watchdogs, parts.digital_outputs, boards, now_ns))

    def _missed(self, now_ns: int) -> None:
        """A bad read: tolerated for the watchdog time; no robot gets power until the next good one."""
        self.record.bad_reads[...] += np.uint64(1)
        age_ns, limit_s, blamed = now_ns - self._good_ns, self._oldest_ns * 1e-9, self._blamed()
        if not self._lost and now_ns - self._missed_ns >= MISSED_REPEAT_NS:
            self._missed_ns = now_ns
            self.reports.warn(codes.READ_MISSED, self.io.name, age_ns * 1e-9, limit_s, boards=blamed)
        if age_ns <= self._oldest_ns:
            return
        # report again for a robot that was commanded to power on meanwhile
        again = self.record.power_requested & (self.record.fault == 0)
        if not self._lost or again.any():
            for robot in range(len(self.robots.names)):
                if not self._lost or again[robot]:
                    self.reports.trip(codes.BAD_READS, robot, value=age_ns * 1e-9, limit=limit_s, boards=blamed)
            self._lost = True

    def _blamed(self) -> tuple[int, ...]:
        """Boards with bad reads since the last call, i.e. in this cycle."""
        counts = self.port.counters.board_bad_reads
        rows = np.flatnonzero(counts > self._bad_by_board)
        self._bad_by_board = counts.copy()
        return tuple(self.robots.board_ids[row] for row in rows)

    def _judge_tracking(self) -> None:
        """Trip on tracking errors beyond their tolerances."""
        pid, position = self.pid, self.samples.position
        tripped = pid.beyond(self.follow.returns(position)) if pid.compare(position) else None
        if tripped is None:
            return
        errors = np.copysign(pid.excess, pid.setpoint_position - position)
        for robot, axes in enumerate(self.robots.slices):
            if tripped[axes].any():
                axis = int(np.argmax(tripped[axes]))
                self.reports.trip(codes.TRACKING, robot, axis, float(errors[axes][axis]),
                                  float(pid.tolerance[axes][axis]), also(tripped[axes]))

    def _not_finite(self, now_ns: int) -> None:
        """For an effort that was not finite, 0 A was sent; switch off its robot."""
        request = self.record.current_request
        finite = np.isfinite(request)
        finite[: self.robots.axes] &= self.pid.finite
        for robot, places in enumerate(self.robots.of_robot):
            bad = ~finite[places]
            if bad.any():
                self.reports.trip(codes.NOT_FINITE, robot, int(np.argmax(bad)), detail=also(bad))
        request[~finite] = 0.0
        self._fault_handler.act(now_ns)

    def _show(self, good: bool, read_ns: int, now_ns: int) -> None:
        """Fill the rest of the record; the boards have been written already."""
        record, counters = self.record, self.port.counters
        if counters.stray != self._strays:
            self._strays = counters.stray
            self._report_stranger(now_ns)
        if good and (self.halves.show() or self.parts.buttons.debounce.is_first):
            self.parts.buttons.settle((now_ns - self._before_ns) * 1e-9)
        self._cycles += 1
        end_ns = self._now_ns()
        cycle, read, received, written, age = self._shown
        cycle[0], read[0], received[0] = self._cycles, read_ns, self.port.recv_ns
        written[0], age[0] = self.port.send_ns, end_ns - self._whole_ns
        if self._is_whole:
            record.sample_age_ns[...] = end_ns - now_ns
        else:
            np.subtract(end_ns, self._sampled_ns, record.sample_age_ns)
        self._timing.step(read_ns, end_ns, counters.waited_ns)

    def _report_stranger(self, now_ns: int) -> None:
        """Report an unknown sender to io's socket."""
        stranger = self.port.stranger
        if stranger != self._stranger and now_ns - self._stranger_ns >= STRANGER_REPEAT_NS:
            self._stranger, self._stranger_ns = stranger, now_ns
            self.reports.warn(codes.FOREIGN_DATAGRAMS, self.io.name, sender=stranger)

    def want(self, wanted: int) -> None:
        """Set the values to compute on demand, see `Samples`."""
        self.samples.want(wanted)

    def shutdown(self) -> None:
        """Zero every output: amplifiers and power off, relays open; then update the record. Runs on every path out.

        The boards come first, with no step before them that an error in the loop may have broken.
        """
        self.pid.effort.fill(0.0)
        for _ in range(FAREWELLS):
            self.parts.outputs.all_off()
            self.parts.outputs.encode(1.0)
            self.port.write_all()
            self.parts.outputs.written()
        self.parts.setup_brakes.shutdown()
        self.parts.cart.shutdown()
        self.parts.digital_outputs.shutdown()
        now_ns = self._now_ns()
        for robot in range(len(self.robots.names)):
            self.follow.enable(robot, False, now_ns)
            self.power.off(robot)
