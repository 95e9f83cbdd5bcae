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
from trocar.procs.io.reports import IoReports
from trocar.procs.io.robots import Robots, Samples
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


@dataclass(frozen=True, slots=True, weakref_slot=True)
class Parts:
    """The parts of every io."""

    robots: Robots
    record: IoRecord
    reports: IoReports
    pid: Pid
    follow: SetpointTracker
    gains: JointGains
    desired: ArmRequests
    faults: Sequence[OwnCell]
    brakes: Brakes
    power: Power
    port: Port
    samples: Samples
    outputs: Outputs
    watchdogs: Watchdogs
    safety: Safety
    bias: Bias
    tasks: Tasks | None
    digital_outputs: DigitalOutputs
    instruments: InstrumentReaders
    setup_brakes: SetupBrakes
    cart: CartOutputs
    buttons: Buttons
    axis_drive: AxisDrive


def assemble(context: IoContext, port: Port, preset: Flags | None = None) -> Parts:
    """The parts for robots on the boards of `port`, which are discovered; their watchdog periods are written.

    `preset` (axes,) marks the encoders that are already set. ValueError if these are not the robots' boards.
    """
    io, record, reports = context.io, context.record, IoReports()
    robots = Robots(io)
    if robots.board_ids != tuple(port.board_ids):
        raise ValueError(f"port has boards {port.board_ids}, the robots are on {robots.board_ids}")
    record.restart()
    record.encoder_set[...] = preset if preset is not None else False
    samples, brakes, pid = Samples(robots, port, record), Brakes(robots, record), _pid(context, robots)
    outputs = Outputs(robots, port, record, brakes)
    watchdogs = Watchdogs(robots, port, reports, context.now_ns())
    power = Power(robots, port, record, outputs, reports, samples, brakes, watchdogs)
    gains = JointGains(robots, samples, pid, reports, context.gains)
    safety = Safety(robots, samples, record, reports)
    follow = SetpointTracker(io, robots, samples, pid, record, reports, context.sources)
    bias = Bias(robots, port, samples, record, reports, follow.encoders_set)
    tasks = Tasks(io, robots, samples, record, pid, reports, context.now_ns) if io.tasks else None
    digital_outputs = DigitalOutputs(robots, port, record, reports)
    return Parts(
        robots, record, reports, pid, follow, gains, ArmRequests(robots, record, follow, context.report),
        _cells(context), brakes, power, port, samples, outputs, watchdogs, safety, bias, tasks, digital_outputs,
        InstrumentReaders(robots, port, reports, context.instruments),
        SetupBrakes(robots, record, digital_outputs, reports), CartOutputs(robots, record, digital_outputs),
        Buttons(robots, port, record, reports), AxisDrive(robots, samples, record, pid, brakes))


def _pid(context: IoContext, robots: Robots) -> Pid:
    record = context.record
    return Pid(configured_gains(context.io, robots), robots.maximum_effort, context.io.period_s, arrays=(
        record.setpoint_position, record.setpoint_velocity, record.setpoint_effort, record.position_error,
        record.disturbance, record.effort_mode))


def _cells(context: IoContext) -> Sequence[OwnCell]:
    return context.cells or [NoFaults() for _ in context.io.robots]
