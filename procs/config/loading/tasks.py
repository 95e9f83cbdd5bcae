"""`trocar.io.tasks`: users' own code in the cycle of io. What they name is found here, and loaded by io alone."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Annotated

from pydantic import AfterValidator, Field

from trocar.procs.config.loading.context import Context
from trocar.procs.config.loading.modules import module_of
from trocar.procs.config.read.problem import Key
from trocar.procs.config.read.source import SourceFile
from trocar.procs.config.read.validate import Rows, Section
from trocar.procs.document import system as document

_TASKS: Key = ("trocar", "io", "tasks")
_LARGEST_SHARE = 0.5  # of a period, for the tasks of one bus together


def _plain(options: dict[str, object]) -> dict[str, object]:
    for name, value in options.items():
        if not _is_plain(value):
            raise ValueError(f"{name} is no plain value")
    return options


def _is_plain(value: object) -> bool:
    """What JSON can carry to io; Section's own check lets no inf and no nan through in fields, but not in here."""
    if isinstance(value, list):
        return all(_is_plain(item) for item in value)
    if isinstance(value, dict):
        return all(isinstance(name, str) and _is_plain(item) for name, item in value.items())
    if isinstance(value, float):
        return value - value == 0.0
    return isinstance(value, (bool, int, str))


_OPTIONS = "numbers (no inf, no nan), texts, true, false, lists and objects of these"
Options = Annotated[dict[str, object], AfterValidator(_plain), Field(description=_OPTIONS)]
Word = Annotated[str, Field(pattern=r"^[A-Za-z_]\w*$", description="the name of a class or function")]


class TaskKeys(Section):
    """One task; absent robots: all that have a joint controller."""

    module: Annotated[str, Field(min_length=1, description="a .py file, or an importable module")]
    name: Word
    robots: Rows[str] = ()
    budget_us: float = Field(default=50.0, ge=1.0, le=1000.0, description="µs")
    over_budget: int = Field(default=10, ge=1, le=1000, description="cycles in a row")
    options: Options = Field(default_factory=dict, description=_OPTIONS)


def with_tasks(context: Context, source: SourceFile, ios: tuple[document.IoConfig, ...],
               rows: Sequence[TaskKeys]) -> tuple[document.IoConfig, ...]:
    """The buses with the tasks of their robots."""
    controlled = [pid.robot for io in ios for pid in io.pids]
    modules = [module_of(context, source, (*_TASKS, index, "module"), row.module) for index, row in enumerate(rows)]
    for index, row in enumerate(rows):
        for place, robot in enumerate(row.robots):
            if robot not in controlled:
                allowed = f"one of {', '.join(controlled)}" if controlled else "there is none"
                context.error(source, (*_TASKS, index, "robots", place), "no joint controller of this name", allowed)
    whole = []
    for io in ios:
        tasks = []
        for row, module in zip(rows, modules, strict=True):
            robots = tuple(pid.robot for pid in io.pids if not row.robots or pid.robot in row.robots)
            if robots:
                tasks.append(document.TaskRow(module, row.name, robots, row.budget_us * 1e-6, row.over_budget,
                                           row.options))
        _check_budgets(context, source, io, tasks)
        whole.append(dataclasses.replace(io, tasks=tuple(tasks)))
    return tuple(whole)


def _check_budgets(context: Context, source: SourceFile, io: document.IoConfig, tasks: list[document.TaskRow]) -> None:
    """The joint controllers, the boards and everything else need their time, too."""
    together_s = sum(task.budget_s * len(task.robots) for task in tasks)
    if together_s > _LARGEST_SHARE * io.period_s:
        text = f"the budgets of {io.name} add up to {together_s * 1e6:.0f} µs (each robot counts)"
        context.error(source, _TASKS, text, f"half its period, {_LARGEST_SHARE * io.period_s * 1e6:.0f} µs")
