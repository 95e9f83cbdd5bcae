"""The inputs of an arm from its process: records, mailboxes and reports of other processes."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

from trocar.procs.arm.other_arm import OtherArm
from trocar.procs.arm.setup_base import SetupBase
from trocar.procs.node.fault_report import FaultReport
from trocar.procs.node.inputs import Fields
from trocar.procs.node.io_faults import power_lost
from trocar.shm.mailbox.client import LoopClient
from trocar.shm.mailbox.generations import NoFaults, OwnCell
from trocar.shm.system.events import Events


@dataclasses.dataclass(frozen=True, slots=True)
class ToolReading:
    """The last reading of the arm's instrument by io: READ with the `tool`, ABSENT or ERROR, since when."""

    status: str = ""
    tool: str = ""
    since_ns: int = 0


def no_other_arm(name: str) -> OtherArm:
    """There are no other arms."""
    raise ValueError(f"no PSM or ECM {name}")


@dataclasses.dataclass(frozen=True, slots=True)
class ArmContext:
    """Everything an arm needs from its process, besides its document row."""

    field: Fields  # of io's record
    robot: int  # index of its robot in io
    first_axis: int
    inputs: Mapping[str, int]  # indices of io's digital inputs by name
    has_brakes: bool
    sender: LoopClient
    state: Fields  # the arm's own records, still with the values of the previous process
    setpoint: Fields
    reports: Events
    fault_report: Callable[[int], FaultReport]  # io's report of its latched fault
    power_report: Callable[[], FaultReport] = power_lost  # the amplifiers that are off after a loss of power
    io_stall: Callable[[int], str] = lambda since_ns: ""  # io's stall since then, after which it restarted; "": none
    gripper: int = -1  # axis of its gripper in io's record, -1: none
    setup_base: SetupBase | None = None  # the setup joints that carry it
    reading: Callable[[], ToolReading] = ToolReading  # the last reading of its instrument's memory by io
    motors: Sequence[float] = ()  # the largest efforts of its actuators; empty: not known
    stall: str = ""  # the stall after which its process restarted; empty: the process was started
    simulated: bool = False  # the system's time is simulated
    other: Callable[[str], OtherArm] = no_other_arm  # another arm by its name, for walls; ValueError: there is none
    walls: Fields | None = None  # the arm's record of walls, still with the values of the previous process
    faults: OwnCell = dataclasses.field(default_factory=NoFaults)  # commands given before a fault are void
