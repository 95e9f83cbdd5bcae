"""What an in-cycle task sees: the interface for users' own code that runs in io, between read and write.

    class Damping:
        def __init__(self, robot: TaskRobot) -> None: ...
        def step(self, sample: Sample, effort: Floats) -> None: ...

How to write, attach and test one: docs/in-cycle.md.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Flags: TypeAlias = NDArray[np.bool_]


@dataclass(frozen=True, slots=True)
class TaskRow:
    """A task in the configuration, made once for each of its robots."""

    module: str  # an absolute path that ends in .py, or the name of an importable module
    name: str  # of the class (or function) that makes it
    robots: tuple[str, ...]
    budget_s: float = 50e-6
    over_budget: int = 10
    options: dict[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class TaskRobot:
    """The robot a task is made for; arrays have one value an actuator and cannot be written."""

    name: str
    axes: tuple[str, ...]  # names of the actuators in the PID file
    joint_types: tuple[str, ...]  # REVOLUTE or PRISMATIC: rad and N·m, or m and N
    period_s: float  # as configured; `Sample.stamp_ns` says what it really was
    lower: Floats  # soft position limits, rad or m
    upper: Floats
    maximum_effort: Floats  # N·m or N; where larger efforts are cut
    options: Mapping[str, object]  # as they stand in the configuration

    def axis(self, name: str) -> int:
        """The place of the actuator of this name; ValueError names those that there are."""
        if name not in self.axes:
            raise ValueError(f"{self.name} has no axis {name}; there are: {', '.join(self.axes)}")
        return self.axes.index(name)


@dataclass(slots=True)
class Sample:
    """One good sample of the robot; the arrays stay the same objects, have one value an actuator, cannot be written."""

    position: Floats  # rad or m
    velocity: Floats  # rad/s or m/s
    current: Floats  # A, measured
    setpoint_position: Floats  # what the joint controller is to follow in this very cycle
    setpoint_velocity: Floats
    setpoint_effort: Floats  # N·m or N, what was sent to the motors in the cycle before
    effort_mode: Flags  # efforts of the arm are passed through instead of following positions
    at_limit: Flags  # the setpoint was clipped to the limits
    stamp_ns: int = 0  # monotonic clock when the sample arrived
    enabled: bool = False  # the joint controller is on; while it is off, contributions count as 0


class Task(Protocol):
    """A user's own code in the cycle."""

    def step(self, sample: Sample, effort: Floats) -> None:
        """Look at the sample and write into `effort` (all 0 before) what to add to the joint controller's efforts."""


TaskMaker: TypeAlias = Callable[[TaskRobot], Task]
