"""The person who confirms before power or motion, and does the manual work."""

from __future__ import annotations

import contextlib
import math
import select
import sys
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

from trocar.shm.time.clock import monotonic_ns
from trocar.tools.commission.subject import Subject
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.output.printing import printable, tell

if TYPE_CHECKING:
    from trocar.tools.commission.person_sim import PersonSim

PATIENCE_S, SWEEP_PATIENCE_S = 120.0, 1800.0


class Declined(Problem):
    """The person did not confirm."""


@dataclass(frozen=True, slots=True)
class Carry:
    """Move one axis of a robot without power by hand, back and forth, by at least this much (rad or m)."""

    subject: Subject
    axis: int
    by: float


@dataclass(frozen=True, slots=True)
class Put:
    """Move all axes of a robot to a position (rad or m) and keep them there."""

    subject: Subject
    position: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Press:
    """Press and release a button; for one that is already pressed in the opposite order."""

    name: str
    pressed: bool


@dataclass(frozen=True, slots=True)
class Stop:
    """Press the emergency stop, or release it."""

    pressed: bool


@dataclass(frozen=True, slots=True)
class Squeeze:
    """Close the gripper of a master, or open it fully."""

    subject: Subject
    closed: bool


@dataclass(frozen=True, slots=True)
class Sweep:
    """Move every axis of a robot, whose brakes are released, from stop to stop, back and forth."""

    subject: Subject


@dataclass(frozen=True, slots=True)
class Rock:
    """Move one axis gently back and forth, as far as its brake lets it."""

    subject: Subject
    axis: int


@dataclass(frozen=True, slots=True)
class Settle:
    """Bring a setup arm of a robot to about this position (m, rad) while its clutch is pressed, and let it rest."""

    robot: str
    arm: str
    clutch: str
    position: tuple[float, ...]


def _typed(question: str) -> str:
    """A line; Declined at the end of input (Ctrl-D)."""
    try:
        return input(question)
    except EOFError:
        raise Declined("not confirmed: the input has ended; run the same command again") from None


Act = Carry | Sweep | Rock | Put | Press | Stop | Squeeze | Settle


Person: TypeAlias = "AtTerminal | PersonSim"


class AtTerminal:
    """A person who reads and types."""

    def __init__(self) -> None:
        """Misuse if no terminal is available."""
        if not sys.stdin.isatty():
            raise Misuse("commissioning asks for confirmation, but there is no terminal; --yes is for emulated boards")

    def confirm(self, danger: str, word: str) -> None:
        """Announce the next action and have the word typed; Declined if it is not."""
        tell(f"\n{danger}", flush=True)
        reported = _typed(f"Type {word} to continue, anything else stops:  ").strip()
        if reported != word:
            raise Declined(f"not confirmed: {reported or 'nothing'!r} was typed, not {word!r}; nothing was switched on")

    def supporting(self, subject: Subject) -> AbstractContextManager[object]:
        """Hold by hand parts that can fall, as requested in `confirm`."""
        return contextlib.nullcontext()

    def agrees(self, question: str) -> bool:
        """Whether the person confirms something that only a look can show."""
        while True:
            reported = _typed(f"{question} [y/n] ").strip().lower()
            if reported in ("y", "yes", "n", "no"):
                return reported.startswith("y")

    def chosen(self, question: str, axes: Sequence[int]) -> tuple[int, ...]:
        """Some of these axes."""
        while True:
            words = _typed(f"{question} [all, none, or numbers of {' '.join(map(str, axes))}] ").split()
            if words in (["all"], ["none"]):
                return tuple(axes) if words == ["all"] else ()
            if words and all(word.isdecimal() and int(word) in axes for word in words):
                return tuple(int(word) for word in words)

    def measured(self, question: str, act: Settle) -> tuple[float, ...]:
        """Joints that the person has measured there, m and rad: the first is typed in mm, the others in degrees."""
        count = len(act.position)
        while True:
            words = _typed(f"{question}: ").replace(",", " ").split()
            try:
                values = [float(word) for word in words]
            except ValueError:
                values = []
            if len(values) != count or not all(map(math.isfinite, values)):
                self.report(f"{count} numbers are needed")
                continue
            shown = f"{values[0]:g} mm, " + ", ".join(f"{value:g}°" for value in values[1:])
            if self.agrees(f"{shown}: is that right?"):
                return values[0] * 1e-3, *map(math.radians, values[1:])

    def doing(self, act: Act, text: str) -> Iterator[None]:
        """Have manual work done: yields while the person is at work, until Enter, or for PATIENCE_S."""
        when = {Rock: "to stop", Settle: "when it is there and its clutch released", Put: "while it is held still",
                Squeeze: "while it is held"}.get(type(act), "when done")
        tell(f"\n{text}\n(press Enter {when})", flush=True)
        end = monotonic_ns() + round((SWEEP_PATIENCE_S if isinstance(act, Sweep | Settle) else PATIENCE_S) * 1e9)
        with contextlib.suppress(GeneratorExit):
            while monotonic_ns() < end:
                yield
                if select.select([sys.stdin], [], [], 0.0)[0]:
                    sys.stdin.readline()
                    break
        print("\r\033[K", end="", flush=True)

    def show(self, line: str) -> None:
        """The measurements meanwhile."""
        print(f"\r\033[K{printable(line, '')}", end="", flush=True)

    def progress(self, line: str) -> None:
        """How far a long measurement is."""
        self.show(line)

    def report(self, line: str) -> None:
        """Something to know."""
        tell(line, flush=True)
