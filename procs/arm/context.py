"""What an arm is given by its process: the records, mailboxes and reports of others."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

from trocar.procs.arm.setup_base import SetupBase
from trocar.procs.arm.supervision import power_lost
from trocar.procs.node.fault_report import FaultReport
from trocar.procs.node.inputs import Fields
from trocar.shm.mailbox.client import LoopClient
from trocar.shm.mailbox.generations import NoFaults, OwnCell
from trocar.shm.system.events import Events


@dataclasses.dataclass(frozen=True, slots=True)
class ToolReading:
    """What io has last read from the arm's instruments: READ with the `tool`, ABSENT or ERROR, since when."""

    status: str = ""
    tool: str = ""
    since_ns: int = 0


@dataclasses.dataclass(frozen=True, slots=True)
class ArmContext:
    """What an arm needs of its process besides its document row."""

    field: Fields  # of io's record
    robot: int  # its robot's place among io's
    first_axis: int
    inputs: Mapping[str, int]  # places of io's digital inputs by name
    has_brakes: bool
    sender: LoopClient
    state: Fields  # the arm's own records, still as a predecessor left them
    setpoint: Fields
    reports: Events
    fault_report: Callable[[int], FaultReport]  # what io has told about its latched fault
    power_report: Callable[[], FaultReport] = power_lost  # which amplifiers are off, when power was lost
    gripper: int = -1  # axis of its gripper in io's record, -1: none
    setup_base: SetupBase | None = None  # the setup joints that carry it
    reading: Callable[[], ToolReading] = ToolReading  # what io has last read from the memory of its instruments
    motors: Sequence[float] = ()  # the largest efforts of its actuators, none: not known
    faults: OwnCell = dataclasses.field(default_factory=NoFaults)  # what was asked for before one is void
