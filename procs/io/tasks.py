"""In-cycle tasks: user code on the same sample as the joint controllers, before the boards are written.

All tasks of a cycle write into rows of one array, whose sum the joint controller adds before it clamps to the effort
limits. A task cannot stop the joint controllers: a task that raises, returns values that are not finite or takes too
long too often is detached and reported, and its row is 0 from that very cycle on. Time is measured with io's clock; in
lock-step that clock does not advance within a cycle, so no task exceeds its budget there.
"""

from __future__ import annotations

import importlib
import importlib.util
import inspect
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType, ModuleType
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document import system as document
from trocar.procs.document.tasks import Sample, Task, TaskMaker, TaskRobot
from trocar.procs.io.pid import Pid
from trocar.procs.io.record import Flags, Floats, IoRecord
from trocar.procs.io.robots import IoData, Robots, Samples
from trocar.procs.node.setup_error import SetupError
from trocar.procs.tables import codes
from trocar.procs.tables.code_row import Code

FORGIVEN_AFTER: Final = 20  # cycles within the budget that compensate one over it

Element = TypeVar("Element", bound=np.generic)


class TaskError(SetupError):
    """A task that cannot be attached; the text names the task, its file and the requirement."""

    def __init__(self, row: document.TaskRow, what: str) -> None:
        super().__init__(f"in-cycle task {_label(row)}{what}")


@dataclass(slots=True)
class Attached:
    """One task of one robot, with its row and its time account."""

    label: str
    file: str
    robot: int
    name: str
    task: Task
    sample: Sample
    effort: Floats  # the task's own view of its row, which it may even reshape
    row: Floats
    budget_ns: int
    patience: int  # permitted cycles over budget in a row; 0: detached
    debt: int = 0  # FORGIVEN_AFTER for each cycle over the budget, less one for each within
    steps: int = 0
    total_ns: int = 0
    worst_ns: int = 0
    was_enabled: bool = False


class Tasks:
    """All tasks of an io; not created if no task is configured."""

    def __init__(self, data: IoData, pid: Pid, now_ns: Callable[[], int]) -> None:
        """Load the modules and create the tasks; TaskError if one fails."""
        robots, io, record, reports = data.robots, data.robots.io, data.record, data.reports
        self._record, self._reports, self._now_ns = record, reports, now_ns
        places = [(row, name) for row in io.tasks for name in row.robots]
        self._rows: Floats = np.zeros((len(places), robots.axes))
        self._finite: Flags = np.ones((len(places), robots.axes), dtype=bool)
        self._attached: list[Attached] = []
        modules: dict[str, ModuleType] = {}  # one for all tasks from the same file
        for row in io.tasks:
            modules[row.module] = modules.get(row.module) or _loaded(row)
        for place, (row, name) in enumerate(places):
            robot = robots.names.index(name)
            axes = robots.slices[robot]
            effort = self._rows[place, axes]
            task = _make(row, _maker(row, modules[row.module]), _robot(io, row, robot, robots))
            sample = _sample(axes, data.samples, record)
            self._attached.append(Attached(
                _label(row), row.module, robot, name, task, sample, effort[:], effort, round(row.budget_s * 1e9),
                row.over_budget))
            reports.status(f"in-cycle task {_label(row)} attached, budget {row.budget_s * 1e6:.0f} µs", name)
        self._sum = pid.contribute()

    def step(self, stamp_ns: int) -> None:
        """Run all tasks on the newest good sample."""
        if not self._attached:
            return
        self._rows.fill(0.0)
        enabled, gone = self._record.pid_enabled, False
        begin_ns = self._now_ns()
        for each in self._attached:
            sample = each.sample
            sample.stamp_ns, sample.enabled = stamp_ns, bool(enabled[each.robot])
            try:
                each.task.step(sample, each.effort)
            except (Exception, SystemExit) as error:
                self._detach(each, codes.TASK_FAILED, _reason(error, each.file))
                gone = True
            end_ns = self._now_ns()
            gone |= self._book(each, end_ns - begin_ns)
            begin_ns = end_ns
        np.isfinite(self._rows, self._finite)
        if b"\0" in self._finite.tobytes():
            self._refuse()
            gone = True
        np.add.reduce(self._rows, axis=0, out=self._sum)
        if gone:
            self._attached = [each for each in self._attached if each.patience]

    def _book(self, each: Attached, spent_ns: int) -> bool:
        """Count the time of a step; returns whether the task was detached for it."""
        if each.was_enabled != each.sample.enabled:
            self._switched(each)
        each.steps += 1
        each.total_ns += spent_ns
        each.worst_ns = max(each.worst_ns, spent_ns)
        if spent_ns <= each.budget_ns:
            each.debt = max(0, each.debt - 1)
            return False
        each.debt += FORGIVEN_AFTER
        if not each.patience or each.debt <= FORGIVEN_AFTER * (each.patience - 1):
            return False
        self._detach(each, codes.TASK_OVER_BUDGET, _times(each), spent_ns * 1e-9, each.budget_ns * 1e-9)
        return True

    def _switched(self, each: Attached) -> None:
        """The joint controller went on or off: report times when it goes off, and restart the counts."""
        each.was_enabled = each.sample.enabled
        if not each.was_enabled:
            self._reports.status(f"in-cycle task {each.label}: {_times(each)}", each.name)
        each.steps = each.total_ns = each.worst_ns = 0

    def _refuse(self) -> None:
        """A row is not finite: detach its task."""
        for each in self._attached:
            bad = ~np.isfinite(each.row)
            if bad.any():
                axis = int(np.argmax(bad))
                self._detach(each, codes.TASK_FAILED, f"effort {each.row[axis]}", axis=axis)
        self._rows[~np.isfinite(self._rows)] = 0.0

    def _detach(self, each: Attached, fault: Code, reason: str, value: float = np.nan, limit: float = np.nan,
                axis: int = -1) -> None:
        """Detach this task and clear its row for this cycle."""
        each.patience = 0
        each.row.fill(0.0)
        self._reports.trip(fault, each.robot, axis, value, limit, f"{each.label}: {reason}")
        self._reports.detached.append(f"in-cycle task {each.label} of {each.name} is detached: {reason}")


def _sample(axes: slice, samples: Samples, record: IoRecord) -> Sample:
    """The robot's part of io's arrays, as read-only views."""
    return Sample(
        _read_only(samples.position[axes]), _read_only(samples.velocity[axes]), _read_only(samples.current[axes]),
        _read_only(record.setpoint_position[axes]), _read_only(record.setpoint_velocity[axes]),
        _read_only(record.setpoint_effort[axes]), _read_only(record.effort_mode[axes]),
        _read_only(record.at_limit[axes]))


def _robot(io: document.IoConfig, row: document.TaskRow, robot: int, robots: Robots) -> TaskRobot:
    name, axes = robots.names[robot], robots.slices[robot]
    gains = next((each.axes for each in io.pids if each.robot == name), ())
    return TaskRobot(
        name, tuple(each.name for each in gains), tuple(each.joint_type for each in robots.actuators[axes]),
        io.period_s, _read_only(robots.lower[axes]), _read_only(robots.upper[axes]),
        _read_only(robots.maximum_effort[axes]), MappingProxyType(row.options))


def _read_only(view: NDArray[Element]) -> NDArray[Element]:
    view.flags.writeable = False
    return view


def _label(row: document.TaskRow) -> str:
    return f"{Path(row.module).stem if row.module.endswith('.py') else row.module}.{row.name}"


def _loaded(row: document.TaskRow) -> ModuleType:
    try:
        return _module(row.module)
    except (Exception, SystemExit) as error:
        raise TaskError(row, f": {row.module} cannot be loaded: {_reason(error, row.module)}") from error


def _maker(row: document.TaskRow, module: ModuleType) -> TaskMaker:
    """The class or function that makes the task."""
    maker = getattr(module, row.name, None)
    if not callable(maker):
        there = [name for name, value in vars(module).items() if callable(value) and not name.startswith("_")]
        raise TaskError(row, f": no class or function {row.name} in {row.module}; it has: {', '.join(there) or 'none'}")
    found: TaskMaker = maker
    return found


def _module(name: str) -> ModuleType:
    if not name.endswith(".py"):
        return importlib.import_module(name)
    spec = importlib.util.spec_from_file_location(re.sub(r"\W", "_", name), name)
    if spec is None or spec.loader is None:
        raise ImportError(f"{name} is no Python module")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def _make(row: document.TaskRow, maker: TaskMaker, robot: TaskRobot) -> Task:
    """Create the task of one robot, and check its signature here, not in the loop."""
    try:
        task = maker(robot)
    except (Exception, SystemExit) as error:
        raise TaskError(row, f" cannot be made for {robot.name}: {_reason(error, row.module)}") from error
    step = getattr(task, "step", None)
    try:
        inspect.signature(step).bind(None, None)  # type: ignore[arg-type]  # also finds an uncallable step
    except (TypeError, ValueError):
        raise TaskError(row, ": it needs a method step(sample, effort)") from None
    return task


def _reason(error: BaseException, file: str) -> str:
    """The error and its line in the user's file; without opening the file, as this may run in the loop."""
    line, trace = 0, error.__traceback__
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == file:
            line = trace.tb_lineno
        trace = trace.tb_next
    return f"{f'line {line}: ' if line else ''}{type(error).__name__}: {error}"


def _times(each: Attached) -> str:
    mean_us = each.total_ns / max(1, each.steps) * 1e-3
    return f"mean {mean_us:.1f} µs, at most {each.worst_ns * 1e-3:.1f} µs in {each.steps} cycles"
