"""Gains of joint controllers as a running system shows them."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.gains import GAINS, value_of
from trocar.procs.document.system import IoConfig, PidAxis
from trocar.shm.system import directory
from trocar.shm.topics import IO_GAINS
from trocar.tools.inspect.watch import document_of
from trocar.tools.output.errors import Problem
from trocar.tools.systems.find import unknown

ALL: Final = -1  # in place of an axis


@dataclass(frozen=True, slots=True)
class Present:
    """The gains of one robot: `values` by key (n,), and `start`, those of its PID file when the system was started."""

    robot: str
    arm: str
    io: str
    file: str
    names: tuple[str, ...]
    values: dict[str, NDArray[np.float64]]
    start: tuple[PidAxis, ...]

    def row(self, axis: int) -> dict[str, float]:
        """All gains of an axis by key, switches as 1 and 0."""
        return {key: float(column[axis]) for key, column in self.values.items()}

    def changed(self, axis: int) -> list[str]:
        """Keys of an axis that are not as in the file."""
        return [gain.key for gain in GAINS if value_of(self.start[axis], gain.key) != self.values[gain.key][axis]]

    def axis(self, text: str) -> int:
        """An axis by number or name, `ALL` for all; Problem names the existing ones."""
        if text == "all":
            return ALL
        if text in self.names:
            return self.names.index(text)
        if text.isdigit() and int(text) < len(self.names):
            return int(text)
        raise Problem(f"axis {text} of {self.robot}; allowed: 0 to {len(self.names) - 1}, {', '.join(self.names)}, all")


def present(system: str, wanted: Sequence[str]) -> list[Present]:
    """The gains of some robots (or arms), in their order; default: all. Problem names the existing ones."""
    ios = document_of(system).ios
    known = {pid.robot: io for io in ios for pid in io.pids}
    by_arm = {pid.arm: pid.robot for io in ios for pid in io.pids}
    robots = [name if name in known else by_arm.get(name, "") for name in wanted] or list(known)
    for name, robot in zip(wanted, robots, strict=False):
        if not robot:
            raise unknown("joint controller", name, known)
    return [_of_robot(system, known[robot], robot) for robot in robots]


def _of_robot(system: str, io: IoConfig, robot: str) -> Present:
    pid = next(pid for pid in io.pids if pid.robot == robot)
    first = io.place(robot).axes.start
    with contextlib.closing(directory.reader(system, io.name, IO_GAINS.name, "io", often=False)) as ring:
        if ring.gone or not ring.newest():
            raise Problem(f"{io.name}, which has the gains of {robot}, does not run (trocar status)")
        values = {gain.key: ring.field(gain.key)[first : first + len(pid.axes)].astype(np.float64) for gain in GAINS}
    return Present(robot, pid.arm, io.name, pid.source, tuple(axis.name for axis in pid.axes), values, pid.axes)
