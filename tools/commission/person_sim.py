"""A simulated person for emulated boards: confirms everything, and does all manual work through `boards`."""

from __future__ import annotations

import contextlib
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from trocar.procs.document.system import SystemConfig
from trocar.shm.memory.closable import Closable
from trocar.shm.system import directory
from trocar.tools.client.remote import Remote
from trocar.tools.commission.person import Act, Carry, Press, Put, Rock, Settle, Squeeze, Stop, Sweep
from trocar.tools.commission.subject import SETUP_JOINTS, Subject
from trocar.tools.output.printing import note

STEPS: Final = 8  # of a motion by hand, each way
BEYOND: Final = 1.3  # times the requested motion
SWEEP_STEPS: Final = 2800  # from stop to stop: a reading that lags by one of them, each way, is still repeated
SWEEP_NOTES: Final = 5  # on one way
CLUTCHED: Final = 10  # looks until the brakes of a setup arm have released, or hold
WAITS: Final = 40  # looks while the person waits for an event
ROCKED_RAD, ROCKED_M = 0.02, 0.003
OPEN, CLOSED = math.radians(60.0), 0.0  # gripper, rad

Order = Callable[[str, Sequence[float], str], object]
Truth = Callable[[Subject], NDArray[np.float64]]


class PersonSim:
    """Has the methods of AtTerminal. `order(command, numbers, text)` does something to the boards, and
    `truth(subject)` is where its actuators are.
    """

    def __init__(self, order: Order, truth: Truth) -> None:
        self._order, self._truth = order, truth

    def confirm(self, danger: str, word: str) -> None:
        """Confirms without a question."""

    @contextlib.contextmanager
    def supporting(self, subject: Subject) -> Iterator[None]:
        self._order("support", (1.0,), subject.name)
        try:
            yield
        finally:
            self._order("support", (0.0,), subject.name)

    def agrees(self, question: str) -> bool:
        return True

    def chosen(self, question: str, axes: Sequence[int]) -> tuple[int, ...]:
        return tuple(axes)

    def show(self, line: str) -> None:
        """Not shown."""

    def progress(self, line: str) -> None:
        note(line)

    def report(self, line: str) -> None:
        note(line)

    def measured(self, question: str, act: Settle) -> tuple[float, ...]:
        return act.position

    def doing(self, act: Act, text: str) -> Iterator[None]:
        match act:
            case Carry(subject, axis, by):
                yield from self._carry(subject, axis, by)
            case Sweep(subject):
                low, high = (np.array(ends) for ends in zip(*map(subject.range_of, range(len(subject.names))),
                                                            strict=True))
                for begin, end in ((self._truth(subject).copy(), low), (low, high), (high, low)):  # a hand never jumps
                    steps = round(np.max(np.abs(end - begin) / (high - low)) * SWEEP_STEPS)
                    for step, goal in enumerate(np.linspace(begin, end, steps)):
                        if step % (SWEEP_STEPS // SWEEP_NOTES) == 0:
                            self.progress(f"{subject.name}: {100 * step / steps:.0f} % of the way to its next stops")
                        self._order("set_position", goal.tolist(), subject.name)
                        yield
            case Rock(subject, axis):
                start, by = self._truth(subject).copy(), ROCKED_M if subject.slides(axis) else ROCKED_RAD
                for sign in itertools.cycle((1.0, -1.0)):
                    goal = start.copy()
                    goal[axis] += sign * by
                    self._order("move_by_hand", goal.tolist(), subject.name)
                    yield
            case Put(subject, position):
                self._order("set_position", position, subject.name)
                yield from (None for _ in range(WAITS))
            case Squeeze(subject, closed):
                self._order("set_position", (CLOSED if closed else OPEN,), subject.name)
                yield from (None for _ in range(WAITS))
            case Settle(robot, arm, clutch, position):
                self._order("press", (1.0,), clutch)
                try:
                    yield from (None for _ in range(CLUTCHED))  # its brakes release
                    self._order("set_position", (*position, *(0.0,) * (SETUP_JOINTS - len(position))), f"{robot}/{arm}")
                finally:
                    self._order("press", (0.0,), clutch)
                yield from (None for _ in range(CLUTCHED))
            case Press(name, pressed):
                self._order("press", (float(pressed),), name)
                try:
                    yield from (None for _ in range(WAITS))
                finally:  # also when the caller stops early
                    self._order("press", (float(not pressed),), name)
                yield from (None for _ in range(WAITS))
            case Stop(pressed):
                self._order("emergency_stop", (float(pressed),), "")
                yield from (None for _ in range(WAITS))

    def _carry(self, subject: Subject, axis: int, by: float) -> Iterator[None]:
        start = self._truth(subject).copy()
        low, high = subject.range_of(axis)
        way = by * BEYOND * (1.0 if start[axis] <= 0.5 * (low + high) else -1.0)
        for k in (*range(1, STEPS + 1), *range(STEPS - 1, -1, -1)):
            goal = start.copy()
            goal[axis] += way * k / STEPS
            self._order("set_position", goal.tolist(), subject.name)
            yield


class AtBoards(PersonSim, Closable):
    """Of a running system; a context manager."""

    def __init__(self, document: SystemConfig) -> None:
        """Attach to its emulated boards."""
        self._remote = Remote(document.name, "boards")
        self._reader = directory.reader(document.name, "boards", "state", "boards")
        self._slices: dict[tuple[str, str], slice] = {}
        first = 0
        for io in document.emulated().ios:
            for robot in io.robots:
                self._slices[io.name, robot.name] = slice(first, first + len(robot.actuators))
                first += len(robot.actuators)
        super().__init__(self._remote.ask, self._position)

    def _position(self, subject: Subject) -> NDArray[np.float64]:
        self._reader.newest()
        where: NDArray[np.float64] = self._reader.field("position")[self._slices[subject.io, subject.name]]
        return where

    def close(self) -> None:
        """Detach."""
        self._remote.close()
        self._reader.close()
