"""The devices that commands and faults act on: for robots on boards, and for KINEMATIC ones without boards."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from trocar.procs.io.arm_requests import ArmRequests
from trocar.procs.io.axis_drive import AxisDrive
from trocar.procs.io.bias import Bias
from trocar.procs.io.brakes import Brakes
from trocar.procs.io.cart_outputs import CartOutputs, SetupBrakes
from trocar.procs.io.digital_outputs import DigitalOutputs
from trocar.procs.io.gains import JointGains
from trocar.procs.io.instruments import InstrumentReaders
from trocar.procs.io.pid import Pid
from trocar.procs.io.power import KinematicPower, Power
from trocar.procs.io.record import IoRecord
from trocar.procs.io.reports import IoReports
from trocar.procs.io.robots import Robots
from trocar.procs.io.safety import Safety
from trocar.procs.io.setpoint_tracker import SetpointTracker
from trocar.shm.mailbox.generations import OwnCell


@dataclass(frozen=True, slots=True)
class BoardDevices:
    """Devices that exist only with boards."""

    bias: Bias
    safety: Safety
    outputs: DigitalOutputs
    gains: JointGains
    instruments: InstrumentReaders
    axis_drive: AxisDrive
    cart: CartOutputs
    setup_brakes: SetupBrakes


@dataclass(frozen=True, slots=True)
class Devices:
    """All devices of an io. `faults` for every robot: commands given before its last fault are void."""

    robots: Robots
    record: IoRecord
    reports: IoReports
    follow: SetpointTracker
    pid: Pid
    power: Power | KinematicPower
    brakes: Brakes
    desired: ArmRequests
    faults: Sequence[OwnCell]
    boards: BoardDevices | None = None
    """None: the robots are KINEMATIC."""
