"""Power of every robot: relay, motor supply, amplifiers; levels after a grace time, so that no edge is ever missed.

    OFF       power_on  → SUPPLY     relay and motor supply commanded, again every 0.1 s until the boards show it
    SUPPLY    supply on → AMPS       amplifiers enabled, again every 0.1 s until they are on
    AMPS      all on    → ON
    any       3 s after power_on: not fully powered, or an amplifier off → fault
    any       power_off → OFF
    OFF       supply_on → ALONE      relay and motor supply only, for a while; no power request: no checks
    ALONE     time over, power_off → OFF
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.fpga import blocks, registers
from trocar.procs.io.brakes import Brakes
from trocar.procs.io.outputs import Outputs
from trocar.procs.io.record import Flags, Floats
from trocar.procs.io.robots import IoData
from trocar.procs.io.watchdogs import Watchdogs
from trocar.procs.node.inputs import FOR_EVER_NS
from trocar.procs.tables import codes

OFF: Final = "OFF"
SUPPLY: Final = "SUPPLY"
AMPS: Final = "AMPS"
ON: Final = "ON"
ALONE: Final = "ALONE"

POWER_GRACE_NS: Final = 3_000_000_000  # some supplies come up slowly; never raise: they overheat the boards meanwhile
FAULT_GRACE_NS: Final = 200_000_000  # the time a supply fault and an old watchdog flag take to clear
AMP_GRACE_NS: Final = 50_000_000  # an amplifier may be off this long: the loss of the supply shows later
RETRY_NS: Final = 100_000_000

GOOD: Final = (registers.STATUS_MV_GOOD | registers.STATUS_RELAY | registers.STATUS_RELAY_FEEDBACK)
WATCHED: Final = GOOD | registers.STATUS_POWER | registers.STATUS_WATCHDOG


@dataclass(slots=True)
class Supply:
    """Progress of one robot towards power."""

    state: str = OFF
    start_ns: int = 0
    retry_ns: int = 0
    watchdog_clear: bool = False  # seen clear since the power request
    amps_off_ns: int = 0  # since when a required amplifier is off; 0: none
    until_ns: int = 0  # end of a supply without amplifiers


class Power:
    """Power state machines of all robots; they run only after a status change or a timeout."""

    def __init__(self, data: IoData, outputs: Outputs, brakes: Brakes, watchdogs: Watchdogs) -> None:
        """Reads the status words in the port's `blocks`."""
        self._outputs, self._brakes, self._watchdogs = outputs, brakes, watchdogs
        self._record, self._reports, self._samples = data.record, data.reports, data.samples
        self._robots, robots, port = data.robots, data.robots, data.port
        self._status = port.blocks[:, blocks.STATUS]
        self.status_column = blocks.STATUS
        n_boards, hardware = len(robots.board_ids), np.array(port.hardware)
        # only a QLA1 reports a supply fault, and a DQLA does not show whether its relay really closed
        self.mask = np.where(hardware == "QLA1", WATCHED | registers.STATUS_MV_FAULT, WATCHED).astype(np.uint32)
        self.relay_unseen: Flags = hardware == "DQLA"
        self._preloads: Flags = hardware == "dRA1"
        self.mask[self._preloads] |= np.uint32(registers.STATUS_PRELOADED)
        self._were_preloaded: Flags = np.zeros(n_boards, dtype=bool)
        self._any_unseen = bool(self.relay_unseen.any())
        self.now: NDArray[np.uint32] = np.zeros(n_boards, dtype=np.uint32)
        self.before: NDArray[np.uint32] = np.zeros(n_boards, dtype=np.uint32)
        self.amps_before: Floats = np.zeros(robots.drives)
        self._supplies = [Supply() for _ in robots.names]
        self._rows = [np.flatnonzero(row) for row in robots.on_board]
        self.wake_ns = 0
        self._switched = [(places >= robots.axes) | (not off)  # drives of a robot that power-on enables
                          for places, off in zip(robots.of_robot, robots.motors_off, strict=True)]
        self.reached: Flags = np.zeros(len(robots.names), dtype=bool)  # all amplifiers have been on
        self.not_preloaded: list[int] = []  # robots whose dRA1 enables no amplifier until their encoders are preloaded
        self._preload_ns = 0
        self._to_close: Flags = np.full(n_boards, robots.io.close_all_relays)  # boards whose relay has not closed yet
        self._close_ns = 0
        self.changed = False  # limits that depend on power need a refresh

    def on(self, robot: int, now_ns: int) -> str:
        """Start the power sequence; a repeated call has no effect. Returns the reason for a refusal, or ""."""
        if self._record.power_requested[robot]:
            return ""
        if why := self._watchdogs.objection(robot):
            return why
        self._record.power_requested[robot] = True
        self._supplies[robot] = Supply(SUPPLY, now_ns)
        self.reached[robot] = False
        self.wake_ns, self.changed = 0, True
        if self._robots.motors_off[robot]:
            self._reports.warn(codes.CALIBRATION_MOTORS, self._robots.names[robot])
        return ""

    def supply(self, robot: int, now_ns: int, for_s: float) -> str:
        """Close the relay and switch the motor supply on for a while, amplifiers off; returns the reason for a refusal,
        or "".
        """
        if self._record.power_requested[robot]:
            return "it is powered"
        if why := self._watchdogs.objection(robot):
            return why
        self._supplies[robot] = Supply(ALONE, now_ns, until_ns=now_ns + round(for_s * 1e9))
        self.wake_ns, self.changed = 0, True
        return ""

    def off(self, robot: int, open_relays: bool = False) -> None:
        """Amplifiers off; motor supply off on boards for which no other robot requests power."""
        record, robots = self._record, self._robots
        was_on = bool(record.power_requested[robot])
        record.power_requested[robot] = record.amps_on[robot] = False
        self._supplies[robot] = Supply()
        self.reached[robot] = False
        self._outputs.disable_amps(robots.of_robot[robot])
        self._brakes.engage(robot)
        free = robots.on_board[robot].copy()
        for other in robots.sharing(robot):
            if record.power_requested[other]:
                free &= ~robots.on_board[other]
        self._outputs.cut_power(free, open_relays)
        self._to_close[free] &= not open_relays
        self.wake_ns, self.changed = 0, True
        if was_on:
            self._reports.status("power off", robots.names[robot])

    def watch(self) -> bool:
        """Take the status words of a good sample; True: they or amplifiers changed since the last `step`."""
        np.bitwise_and(self._status, self.mask, self.now)
        if self._any_unseen:
            relay = self.now[self.relay_unseen] & np.uint32(registers.STATUS_RELAY)
            self.now[self.relay_unseen] |= relay << 1
        return (self.now.tobytes() != self.before.tobytes()
                or self._samples.amp_on.tobytes() != self.amps_before.tobytes())

    def step(self, now_ns: int) -> None:
        """Check the status words of a good sample: after each change, and at `wake_ns`."""
        self.before[...], self.amps_before[...] = self.now, self._samples.amp_on
        self.wake_ns = FOR_EVER_NS
        self.changed = True
        self._look_for_preloads(now_ns)
        self._close_relays(now_ns)
        for robot in range(len(self._supplies)):
            self._show(robot)
            if self._record.power_requested[robot]:
                self._advance(robot, now_ns)
                self._judge(robot, now_ns)
            elif self._supplies[robot].state == ALONE:
                self._supply_alone(robot, now_ns)

    def _look_for_preloads(self, now_ns: int) -> None:
        """List the robots whose boards no longer show that the encoders are preloaded, every 0.1 s until they do.

        A board that has never shown this was preloaded once at the start of io: it may not be able to show it.
        """
        shown = self._preloads & ((self.now & np.uint32(registers.STATUS_PRELOADED)) != 0)
        self._were_preloaded |= shown
        rows = self._were_preloaded & ~shown
        if not rows.any():
            return
        if now_ns >= self._preload_ns:
            self._preload_ns = now_ns + RETRY_NS
            self.not_preloaded += np.flatnonzero((self._robots.on_board & rows).any(axis=1)).tolist()
        self._wake_at(self._preload_ns)

    def _close_relays(self, now_ns: int) -> None:
        """Close all relays after the start, if configured: again every 0.1 s until the boards show it."""
        self._to_close &= (self.now & np.uint32(registers.STATUS_RELAY)) == 0
        if not self._to_close.any():
            return
        if now_ns >= self._close_ns:
            self._close_ns = now_ns + RETRY_NS
            self._outputs.close_relays(self._to_close)
        self._wake_at(self._close_ns)

    def _show(self, robot: int) -> None:
        """Set the flags of the record: good flags need every board, bad ones any board."""
        record, words = self._record, self.now[self._rows[robot]]
        every, some = int(np.bitwise_and.reduce(words)), int(np.bitwise_or.reduce(words))
        bad = registers.STATUS_WATCHDOG | registers.STATUS_MV_FAULT
        powered = every & GOOD == GOOD and not some & bad and len(words) > 0
        if powered != record.powered[robot] and record.power_requested[robot]:
            self._reports.status("powered" if powered else "power lost", self._robots.names[robot])
        record.powered[robot] = powered
        if record.watchdog[robot] and not some & registers.STATUS_WATCHDOG:
            self._reports.status("the watchdog is cleared", self._robots.names[robot])
        record.watchdog[robot] = bool(some & registers.STATUS_WATCHDOG)
        record.power_fault[robot] = bool(some & registers.STATUS_MV_FAULT)
        record.relay[robot] = bool(every & registers.STATUS_RELAY_FEEDBACK)
        amps = self._samples.amp_on[self._robots.of_robot[robot][self._switched[robot]]] > 0.5
        record.amps_on[robot] = bool(amps.all()) and len(words) > 0 and bool(record.power_requested[robot])

    def _advance(self, robot: int, now_ns: int) -> None:
        supply, record = self._supplies[robot], self._record
        every = int(np.bitwise_and.reduce(self.now[self._rows[robot]]))
        in_time = now_ns - supply.start_ns <= POWER_GRACE_NS
        commanded = every & registers.STATUS_POWER and every & registers.STATUS_RELAY
        if not record.watchdog[robot]:
            supply.watchdog_clear = True
        if supply.state == SUPPLY and commanded and not record.watchdog[robot]:
            supply.state, supply.retry_ns = AMPS, now_ns
        if supply.state == AMPS and record.amps_on[robot]:
            supply.state = ON
            self.reached[robot] = True
            self._reports.status("amplifiers on", self._robots.names[robot])
        if supply.state in (SUPPLY, AMPS) and in_time and now_ns >= supply.retry_ns:
            supply.retry_ns = now_ns + RETRY_NS
            if supply.state == SUPPLY:
                self._outputs.command_power(self._robots.on_board[robot], relay=True)
            else:
                self._outputs.enable_amps(self._robots.of_robot[robot][self._switched[robot]])
        if supply.state in (SUPPLY, AMPS):
            self._wake_at(supply.retry_ns)

    def _supply_alone(self, robot: int, now_ns: int) -> None:
        supply, commanded = self._supplies[robot], registers.STATUS_POWER | registers.STATUS_RELAY
        if now_ns >= supply.until_ns:
            self.off(robot)
            return
        is_on = int(np.bitwise_and.reduce(self.now[self._rows[robot]])) & commanded == commanded
        in_time = now_ns - supply.start_ns <= POWER_GRACE_NS
        if not is_on and in_time and now_ns >= supply.retry_ns:
            supply.retry_ns = now_ns + RETRY_NS
            self._outputs.command_power(self._robots.on_board[robot], relay=True)
        self._wake_at(supply.until_ns if is_on or not in_time else min(supply.retry_ns, supply.until_ns))

    def _judge(self, robot: int, now_ns: int) -> None:
        """Trip on every wrong state whose grace time is over; all are reported, none hides another."""
        supply, record, reports = self._supplies[robot], self._record, self._reports
        age_ns = now_ns - supply.start_ns
        if record.watchdog[robot] and (supply.watchdog_clear or age_ns > FAULT_GRACE_NS):
            reports.trip(codes.WATCHDOG, robot, boards=self._with(robot, registers.STATUS_WATCHDOG))
        if record.power_fault[robot] and age_ns > FAULT_GRACE_NS:
            reports.trip(codes.POWER_FAULT, robot, boards=self._with(robot, registers.STATUS_MV_FAULT))
        words = self.now[self._rows[robot]]
        supplied = int(np.bitwise_and.reduce(words)) & GOOD == GOOD and len(words) > 0
        if not supplied and (age_ns > POWER_GRACE_NS or record.pid_enabled[robot]):
            rows = self._rows[robot][words & GOOD != GOOD]
            reports.trip(codes.POWER_LOST if supply.state == ON else codes.POWER_TIMEOUT, robot,
                         boards=tuple(self._robots.board_ids[row] for row in rows))
        if record.powered[robot] and not record.amps_on[robot]:
            self._judge_amps(robot, now_ns, age_ns)
        else:
            supply.amps_off_ns = 0
        if age_ns <= FAULT_GRACE_NS:
            self._wake_at(supply.start_ns + FAULT_GRACE_NS + 1)
        elif age_ns <= POWER_GRACE_NS:
            self._wake_at(supply.start_ns + POWER_GRACE_NS + 1)

    def _judge_amps(self, robot: int, now_ns: int, age_ns: int) -> None:
        supply = self._supplies[robot]
        if supply.state == ON:
            supply.amps_off_ns = supply.amps_off_ns or now_ns
            self._wake_at(supply.amps_off_ns + AMP_GRACE_NS + 1)
            late = now_ns - supply.amps_off_ns > AMP_GRACE_NS
        else:
            late = age_ns > POWER_GRACE_NS
        if late:
            off = ~(self._samples.amp_on[self._robots.of_robot[robot]] > 0.5) & self._switched[robot]
            self._reports.trip_axes(codes.AMPLIFIER, robot, off)

    def _with(self, robot: int, bit: int) -> tuple[int, ...]:
        """Boards of a robot with this status bit."""
        rows = self._rows[robot]
        return tuple(self._robots.board_ids[row] for row in rows[(self.now[rows] & np.uint32(bit)) != 0])

    def _wake_at(self, when_ns: int) -> None:
        self.wake_ns = min(self.wake_ns, when_ns)
