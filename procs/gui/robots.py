"""The robots of all ios: where their actuators and brakes are in records, and how pages call them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import quote

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.gains import PidAxis
from trocar.procs.document.system import IoConfig, PidConfig, Robot, SystemConfig
from trocar.procs.gui.rings import Rings, present
from trocar.procs.gui.sources import RecordSource
from trocar.procs.node.fault_report import fault_of
from trocar.shm.topics import IO_GAINS, IO_STATE

NEVER_S: Final = 1e6
PINS: Final = ("input", "output", "age_ns")
WHOLE: Final = ...
Place = int | slice | NDArray[np.intp]


@dataclass(frozen=True, slots=True)
class IoRobot:
    """One robot of an io."""

    io: IoConfig
    place: int
    robot: Robot
    axes: slice
    """Of the io's actuators."""
    brakes: slice
    """Of its drives."""
    pid: PidConfig | None

    @property
    def source(self) -> str:
        """Part of the io's state about this robot."""
        return f"{self.io.name}/robot{self.place}"

    @property
    def gains(self) -> str:
        """Its gains."""
        return f"{self.io.name}/gains{self.place}"

    def path(self, section: str) -> str:
        """Its page."""
        return f"/{section}/{quote(self.io.name)}/{quote(self.robot.name)}"

    @property
    def is_kinematic(self) -> bool:
        """Whether the robot has no boards."""
        return not self.io.port

    @property
    def axis_names(self) -> list[str]:
        """Of its actuators, for people."""
        names = [axis.name.replace("_", " ") for axis in self.pid.axes] if self.pid else []
        return [names[i] if i < len(names) else f"actuator {i}" for i in range(len(self.robot.actuators))]

    def cuts(self, rows: tuple[Any, ...]) -> dict[str, Place]:
        """Positions of its own values in the fields of a topic; none for values not about a robot."""
        drives = np.concatenate([np.arange(self.axes.start, self.axes.stop),
                                 np.arange(self.brakes.start, self.brakes.stop)])
        places: dict[str, Place] = {"(axes,)": self.axes, "(drives,)": drives, "(robots,)": self.place}
        return {row.name: place for row in rows for size, place in places.items() if row.dtype.startswith(size)}


def robots_of(document: SystemConfig) -> list[IoRobot]:
    """All robots of a system."""
    found = []
    for io in document.ios:
        for place in io.places:
            pid = next((pid for pid in io.pids if pid.robot == place.robot.name), None)
            found.append(IoRobot(io, place.row, place.robot, place.axes, place.brakes, pid))
    return found


def with_actuators(robots: list[IoRobot]) -> list[IoRobot]:
    """Those with actuators: others have inputs or outputs only."""
    return [robot for robot in robots if robot.robot.actuators]


def with_gains(robots: list[IoRobot]) -> list[IoRobot]:
    """Those with a joint controller that drives motors."""
    return [robot for robot in with_actuators(robots) if robot.pid is not None and not robot.is_kinematic]


def slides(robot: Robot, pid: PidConfig | None) -> list[bool]:
    """Which actuators are prismatic; from the joint controller if the IO file does not tell."""
    kinds = [actuator.joint_type for actuator in robot.actuators]
    axes: tuple[PidAxis, ...] = pid.axes if pid else ()
    for i, axis in enumerate(axes[: len(kinds)]):
        kinds[i] = axis.joint_type if kinds[i] not in ("REVOLUTE", "PRISMATIC") else kinds[i]
    return [kind == "PRISMATIC" for kind in kinds]


class RobotSource(RecordSource):
    """The state of one robot: its share of the io's record, and its fault in words."""

    def __init__(self, system: str, robot: IoRobot, *, simulated: bool, rings: Rings = present) -> None:
        """Attach; SegmentError when it cannot be read."""
        self._name = robot.robot.name
        super().__init__(system, robot.io.name, IO_STATE.name, simulated=simulated, cuts=robot.cuts(IO_STATE.fields),
                         rings=rings)

    def read(self, now_ns: int) -> dict[str, Any]:
        """Its fields; `cause` and `remedy` of a latched fault. Its age is that of its boards' last good sample."""
        found = super().read(now_ns)
        _as_old_as(found, "sample_age_ns")
        fault = fault_of(found.get("fault") or 0)
        if fault is not None:
            found["cause"], found["remedy"] = fault.cause, fault.remedy_for(self._name)
        return found


class PinsSource(RecordSource):
    """Inputs and outputs of an io, as old as its oldest board sample: pages cannot tell which board that is."""

    def __init__(self, system: str, io: str, *, simulated: bool, rings: Rings = present) -> None:
        """Attach; SegmentError when it cannot be read."""
        super().__init__(system, io, IO_STATE.name, simulated=simulated, cuts=dict.fromkeys(PINS, WHOLE), rings=rings)

    def read(self, now_ns: int) -> dict[str, Any]:
        """`input` and `output`."""
        found = super().read(now_ns)
        _as_old_as(found, "age_ns")
        return found


def _as_old_as(found: dict[str, Any], field: str) -> None:
    """While boards are absent, an io still publishes; it shows their last valid values."""
    if found["age"] is not None:
        sampled_s = round(float(found.pop(field)) * 1e-9, 1)
        found["age"] = max(found["age"], sampled_s) if sampled_s < NEVER_S else None


def gains_source(system: str, robot: IoRobot, rings: Rings = present) -> RecordSource:
    """The gains of one robot."""
    return RecordSource(system, robot.io.name, IO_GAINS.name, simulated=False, cuts=robot.cuts(IO_GAINS.fields),
                        ages=False, rings=rings)
