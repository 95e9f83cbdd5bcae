"""Gains of the running joint controllers: changed by command, reported as events, published in a record."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from trocar.procs.document.gains import GAINS, changed, leap, value_of
from trocar.procs.document.system import IoConfig, PidAxis
from trocar.procs.io.pid import Pid
from trocar.procs.io.record import Field, private
from trocar.procs.io.robots import IoData, Robots
from trocar.shm.topics import IO_GAINS

ALL: Final = -1  # in place of an axis


class JointGains:
    """The gains of all axes; `record` is their published form."""

    def __init__(self, data: IoData, pid: Pid, field: Field | None) -> None:
        """Shows the gains of the files. `field` gives the arrays of the record by name; None: not published."""
        self._robots, self._samples, self._reports, self._pid = data.robots, data.samples, data.reports, pid
        self._known = list(pid.gains)
        """Gains at the controllers' last switch-on, at first the files', and gains confirmed since."""
        field = field or private(IO_GAINS, {"axes": data.robots.axes})
        self.record = {row.name: field(row.name) for row in IO_GAINS.fields}
        self.record["changes"][...] = 0
        self._show(range(data.robots.axes))

    def change(self, robot: int, axis: int, keys: Sequence[str], values: Sequence[float], who: str) -> str:
        """Change `keys` of one axis, or of `ALL` of a robot, from this cycle on; all or nothing.

        Returns the reason for a refusal, or "". `who` is the sender, for the report.
        """
        axes = self._robots.slices[robot]
        count = axes.stop - axes.start
        if not self._pid.controlled[axes].all() or not count:
            return "it has no joint controller"
        if axis != ALL and not 0 <= axis < count:
            return f"axis {axis}; allowed: 0 to {count - 1}, {ALL} for all"
        if not keys or len(keys) != len(values):
            return f"{len(keys)} gains and {len(values)} values; allowed: an axis, then a value for each gain"
        places = [*range(axes.start, axes.stop)] if axis == ALL else [axes.start + axis]
        new = {}
        for place in places:
            try:
                new[place] = changed(self._pid.gains[place], keys, values, running=bool(self._pid.enabled[place]))
            except ValueError as error:
                return f"axis {place - axes.start}: {error}"
        before = {place: self._pid.gains[place] for place in places}
        for place in places:
            again = [key for key in keys if value_of(before[place], key) == value_of(new[place], key)]
            known = changed(self._known[place], again, [value_of(new[place], key) for key in again], running=False)
            self._known[place] = new[place] if self._pid.enabled[place] else known
        self._pid.configure(new, self._samples.velocity)
        self.record["changes"] += 1
        self._show(places)
        for place in places:
            steps = [f"{key} {value_of(before[place], key):.9g} -> {value_of(new[place], key):.9g}" for key in keys]
            text = f"gains changed by {who}: {', '.join(steps)}"
            self._reports.status(text, self._robots.names[robot], place - axes.start)
        return ""

    def objection(self, robot: int) -> str:
        """Why a joint controller with these gains is not switched on (a misplaced decimal point), or ""."""
        axes = self._robots.slices[robot]
        for place in range(axes.start, axes.stop):
            if step := leap(self._known[place], self._pid.gains[place]):
                return f"axis {place - axes.start}: {step}, used last; set it again to confirm"
        return ""

    def switched_on(self, robot: int) -> None:
        """The joint controller of a robot is on with its present gains."""
        axes = self._robots.slices[robot]
        self._known[axes] = self._pid.gains[axes]

    def _show(self, places: Sequence[int]) -> None:
        for gain in GAINS:
            column = self.record[gain.key]
            for place in places:
                column[place] = value_of(self._pid.gains[place], gain.key)
        self._reports.changed.add(IO_GAINS.name)


def configured_gains(io: IoConfig, robots: Robots) -> list[PidAxis | None]:
    """Gains per flat axis, None where no controller is configured."""
    gains: list[PidAxis | None] = [None] * robots.axes
    for row in io.pids:
        axes = robots.slices[robots.names.index(row.robot)]
        if len(row.axes) != axes.stop - axes.start:
            raise ValueError(f"{row.source or row.robot}: {len(row.axes)} actuators; its robot has "
                             f"{axes.stop - axes.start}")
        gains[axes] = row.axes
    return gains
