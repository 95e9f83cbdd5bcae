"""A Classic cart's interface board through io: samples in order, flags of the newest record, and commands to io."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.cart import channel_inputs
from trocar.procs.document.system import IoConfig, RecordPlace
from trocar.procs.node.fault_report import FaultReport, reported
from trocar.procs.node.io_faults import HARMLESS, power_lost
from trocar.procs.suj.multiplexer import PLUGS
from trocar.procs.tables import codes
from trocar.shm.mailbox.client import LoopClient
from trocar.shm.ring.ring import RingReader
from trocar.shm.system.events import Events

SILENT_NS: Final = 50_000_000  # io writes 1500 records a second
MOST: Final = 256  # samples read in one cycle


class IoMailbox:
    """io's mailbox: refusals are reported, once in a row."""

    def __init__(self, commands: LoopClient, reports: Events, name: str) -> None:
        """`commands`: our place in the mailbox; if that is full, the multiplexer detects it and restarts.

        `name`: that of this process.
        """
        self.commands, self._reports, self._name, self._reported = commands, reports, name, ""

    @property
    def is_authorized(self) -> bool:
        """Whether messages are authorized by an operator's command; not after the start of a process."""
        return bool(self.commands.origin.id)

    def poll(self) -> None:
        """Read the replies."""
        for reply in self.commands.poll():
            if reply.outcome == "refused" and reply.text != self._reported:
                self._reported = reply.text
                self._reports.report(codes.IO_REFUSED, f"{self._name}: io refuses: {reply.text}", self._name)


class InterfaceBoard:
    """`look` reads io's records since the last call; flags are those of the newest one, buttons those of the newest
    good sample.

    `pressed` are the clutch buttons of plugs 1 to 4, `up` and `down` those of the lift.
    """

    def __init__(self, io: IoConfig, place: RecordPlace, records: RingReader, orders: IoMailbox,
                 fault_report: Callable[[int], FaultReport] = reported,
                 power_report: Callable[[], FaultReport] = power_lost,
                 io_stall: Callable[[int], str] = lambda since_ns: "") -> None:
        """`place` is that of the cart's robot in `io`; `fault_report` gives io's report of its latched fault,
        `power_report` that of a loss of power, `io_stall` that of a stall after which io restarted (empty: none).
        """
        robot, row = place.robot.name, slice(place.row, place.row + 1)
        self.robot, self._records, self._orders = robot, records, orders
        self.fault_report, self.power_report, self.io_stall = fault_report, power_report, io_stall
        self._volts = records.field("pot_voltage")[place.axes.start : place.axes.start + PLUGS]
        self._flags = {name: records.field(name)[row].reshape(()) for name in (
            "power_requested", "powered", "amps_on", "pid_enabled", "pid_generation", "bias_generation", "fault")}
        self._input = records.field("input")
        self._valid = records.field("robot_valid")[row].reshape(())
        self.write_ns = records.field("write_ns")
        names = [row.name for row in io.digital_inputs]
        self._lines = np.array([names.index(name) for name in channel_inputs(robot)])
        self._buttons = [names.index(n) if n in names else -1
                         for n in (*(f"SUJ_clutch_{plug + 1}" for plug in range(PLUGS)), "motor_up", "motor_down")]
        self.pressed: NDArray[np.bool_] = np.zeros(PLUGS, dtype=bool)
        self.up = self.down = False
        self.power_requested = self.powered = self.amps_on = self.pid_enabled = False
        self.pid_generation = self.bias_generation = self.fault = 0
        self.stamp_ns = self.record_ns = self.epoch = 0
        self._lost = records.lost

    def look(self, sample: Callable[[int, int, NDArray[np.float64]], None]) -> bool:
        """Pass every good sample to `sample(stamp, channel, volts)`; False if some were missed in between."""
        records, whole = self._records, True
        for _ in range(MOST):
            if not records.next():
                break
            self.record_ns = records.stamp_ns
            for name, cell in self._flags.items():
                setattr(self, name, cell.item())
            if self._valid.item():
                self.stamp_ns = records.stamp_ns
                sample(self.stamp_ns, int(self._input[self._lines] @ (1, 2, 4, 8)), self._volts)
                self._take_buttons()
            else:
                whole = False
        whole = whole and records.lost == self._lost
        self._lost = records.lost
        self.epoch = records.epoch
        return whole

    def _take_buttons(self) -> None:
        pressed = [place >= 0 and bool(self._input[place]) for place in self._buttons]
        self.pressed[...] = pressed[:PLUGS]
        self.up, self.down = pressed[PLUGS:]

    def is_fresh(self, now_ns: int) -> bool:
        """Whether io and its boards send fresh samples."""
        return _is_recent(self.stamp_ns, now_ns)

    def io_answers(self, now_ns: int) -> bool:
        """Whether io sends records, with good samples or without."""
        return _is_recent(self.record_ns, now_ns)

    @property
    def has_fault(self) -> bool:
        """Whether io has latched a fault of this robot that prevents operation."""
        return self.fault not in HARMLESS

    @property
    def is_authorized(self) -> bool:
        """Whether an operator has given a command since this process started."""
        return self._orders.is_authorized

    def ask(self, name: str, *values: float) -> None:
        """Send io a command for the cart's robot; refusals are reported."""
        self._orders.commands.send(name, values, self.robot)


def _is_recent(stamp_ns: int, now_ns: int) -> bool:
    return stamp_ns > 0 and -SILENT_NS <= now_ns - stamp_ns <= SILENT_NS
