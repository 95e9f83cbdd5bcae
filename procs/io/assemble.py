"""The parts of one io, put together in one place: each gets those that it uses, complete.

The order is theirs: a part comes after all that it is made of.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from trocar.procs.document.system import IoConfig
from trocar.procs.io.arm_requests import ArmRequests, DesiredCommand
from trocar.procs.io.axis_drive import AxisDrive
from trocar.procs.io.bias import Bias
from trocar.procs.io.brake_trial import BrakeTrials
from trocar.procs.io.brakes import Brakes
from trocar.procs.io.bus.port import Port
from trocar.procs.io.buttons import Buttons
from trocar.procs.io.cart_outputs import CartOutputs, SetupBrakes
from trocar.procs.io.digital_outputs import DigitalOutputs
from trocar.procs.io.gains import JointGains, configured_gains
from trocar.procs.io.instruments import InstrumentReaders
from trocar.procs.io.outputs import Outputs
from trocar.procs.io.pid import Pid
from trocar.procs.io.power import Power
from trocar.procs.io.record import Field, Flags, IoRecord
from trocar.procs.io.robots import IoData
from trocar.procs.io.safety import Safety
from trocar.procs.io.setpoint_rings import RingSource
from trocar.procs.io.setpoint_tracker import SetpointTracker
from trocar.procs.io.tasks import Tasks
from trocar.procs.io.watchdogs import Watchdogs
from trocar.procs.node.inputs import FOR_EVER_NS
from trocar.shm.mailbox.generations import NoFaults, OwnCell


@dataclass(frozen=True, slots=True)
class IoContext:
    """What an io gets from its process."""

    io: IoConfig
    now_ns: Callable[[], int]
    record: IoRecord
    sources: Sequence[RingSource]
    """Setpoints, in the order of `io.pids`."""
    cells: Sequence[OwnCell] = ()
    """Fault generations of the robots, in the order of `io.robots`: older commands are refused; (): no command is."""
    gains: Field | None = None
    instruments: Field | None = None
    """The fields of these records by name; None: not published."""
    report: Callable[[DesiredCommand, str, str], None] | None = None
    """Receives the outcomes of the arms' desired states."""
    is_over: Callable[[], bool] = bool
    """Whether a stall has interrupted this cycle."""
    over_ns: Callable[[], int] = lambda: FOR_EVER_NS
    """After which time on CLOCK_BOOTTIME that is so."""


class Parts(IoData):
    """The parts of every io."""

    def __init__(self, context: IoContext, port: Port, preset: Flags | None = None) -> None:
        """For robots on the boards of `port`, which are discovered; their watchdog periods are written.

        `preset` (axes,) marks the encoders that are already set. ValueError if these are not the robots' boards.
        """
        super().__init__(context.io, port, context.record)
        io, record, robots = context.io, context.record, self.robots
        record.encoder_set[...] = preset if preset is not None else False
        self.faults: Sequence[OwnCell] = context.cells or [NoFaults() for _ in io.robots]
        self.pid = Pid(configured_gains(io, robots), robots.maximum_effort, io.period_s, arrays=(
            record.setpoint_position, record.setpoint_velocity, record.setpoint_effort, record.position_error,
            record.disturbance, record.effort_mode))
        self.brakes = Brakes(self)
        self.outputs = Outputs(self, self.brakes)
        self.watchdogs = Watchdogs(self, context.now_ns())
        self.power = Power(self, self.outputs, self.brakes, self.watchdogs)
        self.gains = JointGains(self, self.pid, context.gains)
        self.safety = Safety(self)
        self.follow = SetpointTracker(self, self.pid, context.sources)
        self.desired = ArmRequests(self, self.follow, context.report)
        self.bias = Bias(self, self.follow.encoders_set)
        self.tasks = Tasks(self, self.pid, context.now_ns) if io.tasks else None
        self.digital_outputs = DigitalOutputs(self)
        self.instruments = InstrumentReaders(self, context.instruments)
        self.setup_brakes = SetupBrakes(self, self.digital_outputs)
        self.cart = CartOutputs(self, self.digital_outputs)
        self.buttons = Buttons(self)
        self.axis_drive = AxisDrive(self, self.pid, self.brakes)
        self.brake_trials = BrakeTrials(self, self.brakes)
