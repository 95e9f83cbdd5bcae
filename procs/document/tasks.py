"""In-cycle tasks: the interface for users' code that runs in io's cycle, between read and write.

    class Damping:
        def __init__(self, robot: TaskRobot) -> None: ...
        def step(self, sample: Sample, effort: Floats) -> None: ...

See docs/in-cycle.md to write, attach and test a task.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.keys import Key

Floats: TypeAlias = NDArray[np.float64]
Flags: TypeAlias = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class TaskRow:
    """A configured task, made once for each of its robots."""

    module: str  # an absolute path that ends in .py, or the name of an importable module
    name: str  # of the class (or function) that makes it
    robots: tuple[str, ...]
    budget_s: float = 50e-6
    over_budget: Annotated[int, Key(1, 1000, "cycles in a row")] = 10
    options: dict[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class TaskRobot:
    """The robot of a task; arrays have one value per actuator and are read-only."""

    name: str
    axes: tuple[str, ...]  # names of the actuators in the PID file
    joint_types: tuple[str, ...]  # REVOLUTE or PRISMATIC: rad and N·m, or m and N
    period_s: float  # as configured; `Sample.stamp_ns` shows the actual one
    lower: Floats  # soft position limits, rad or m
    upper: Floats
    maximum_effort: Floats  # N·m or N; larger efforts are clipped
    options: Mapping[str, object]  # as in the configuration

    def axis(self, name: str) -> int:
        """The index of the actuator with this name; ValueError lists the existing ones."""
        if name not in self.axes:
            raise ValueError(f"{self.name} has no axis {name}; there are: {', '.join(self.axes)}")
        return self.axes.index(name)


@dataclass(slots=True)
class Sample:
    """One good sample of the robot; arrays are always the same objects, read-only, with one value per actuator."""

    position: Floats  # rad or m
    velocity: Floats  # rad/s or m/s
    current: Floats  # A, measured
    setpoint_position: Floats  # setpoint of the joint controller in this cycle
    setpoint_velocity: Floats
    setpoint_effort: Floats  # N·m or N, sent to the motors in the previous cycle
    effort_mode: Flags  # the arm's efforts are passed through, positions are not followed
    at_limit: Flags  # the setpoint was clipped to the limits
    stamp_ns: int = 0  # monotonic clock when the sample arrived
    enabled: bool = False  # the joint controller is on; while it is off, contributions count as 0


class Task(Protocol):
    """A user's code in io's cycle."""

    def step(self, sample: Sample, effort: Floats) -> None:
        """Write efforts into `effort` (initially 0) that are added to those of the joint controller."""


TaskMaker: TypeAlias = Callable[[TaskRobot], Task]
