"""What happened in a storm: what the person asked for, what was done to the system, and what came of it."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from tests.soak.judge import Ask, Attempt, Command, Intervention, LiftEnd, Loss
from trocar.shm.time.clock import monotonic_ns

OPEN = 1 << 62


@dataclass(slots=True)
class Asking:
    """Something that was asked for and goes on until `close`.

    `voidable`: it is over when the person or a fault ends it; a process that is held up ends it too, unless it is a
    `stream`, of a program that asks again and again. What was asked for may last `settling_ns` longer than the asking.
    """

    ask: Ask
    voidable: bool
    stream: bool
    settling_ns: int = 0
    end_ns: int = OPEN

    def close(self, in_ns: int | None = None) -> None:
        """It is over, now or a bit later; nothing where it is already."""
        self.end_ns = min(self.end_ns, monotonic_ns() + (self.settling_ns if in_ns is None else in_ns))


@dataclass(frozen=True, slots=True)
class Entry:
    """One line: when, what kind (event, person, state, problem), in words."""

    stamp_ns: int
    kind: str
    words: str


@dataclass
class Diary:
    """Of one run of the system."""

    askings: list[Asking] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    losses: list[Loss] = field(default_factory=list)
    entries: list[Entry] = field(default_factory=list)
    stops: list[Intervention] = field(default_factory=list)
    numbers: list[Intervention] = field(default_factory=list)
    lifts: list[Intervention] = field(default_factory=list)
    lift_ends: list[LiftEnd] = field(default_factory=list)
    attempts: list[Attempt] = field(default_factory=list)

    def note(self, kind: str, words: str) -> None:
        """Write a line."""
        self.entries.append(Entry(monotonic_ns(), kind, words))

    def ask(self, robot: str, mode: str, joints: Sequence[float] = (), *, leader: str = "", scale: float = 0.0,
            tip: Sequence[float] = (), exact: bool = False, voidable: bool = True, stream: bool = False,
            settling_ns: int = 0) -> Asking:
        """Motion is asked for from now on; see Asking."""
        ask = Ask(robot, mode, monotonic_ns(), OPEN, tuple(joints), leader, scale, tuple(tip), exact)
        self.askings.append(asking := Asking(ask, voidable, stream, settling_ns))
        return asking

    def command(self, robots: Sequence[str], words: str) -> None:
        """The person is about to give a command that may power these robots."""
        now = monotonic_ns()
        self.commands += [Command(robot, now, words) for robot in robots]
        self.entries.append(Entry(now, "person", words))

    def lose(self, robots: Sequence[str], words: str) -> None:
        """These robots have a fault or no power from now on; nothing that was asked of them before is done any more."""
        now = monotonic_ns()
        self.losses += [Loss(robot, now, words) for robot in robots]
        self.void(robots)

    def void(self, robots: Sequence[str], *, streams: bool = True) -> None:
        """What was asked of these robots is dropped now; without `streams` only what was asked for once."""
        for asking in self.askings:
            if asking.voidable and asking.ask.robot in robots and (streams or not asking.stream):
                asking.close()

    def stop(self, robots: Sequence[str], words: str) -> None:
        """Another program has stopped these robots: what was asked of them before is over."""
        self.stops += [Intervention(robot, monotonic_ns(), words) for robot in robots]
        self.void(robots)

    def wrong(self, robot: str, words: str) -> None:
        """A client is about to send wrong numbers."""
        self.numbers.append(Intervention(robot, monotonic_ns(), words))
        self.note("event", words)

    def done(self, robot: str, besides: Sequence[Intervention]) -> list[Intervention]:
        """What was done to the system or asked of a robot, but for these."""
        words = {mark.words for mark in besides}
        return [Intervention(robot, entry.stamp_ns, entry.words) for entry in self.entries
                if entry.kind in ("event", "person") and entry.words not in words]

    def deaths(self, robot: str) -> list[Intervention]:
        """When the process of a robot was killed or stopped."""
        return [Intervention(robot, entry.stamp_ns, entry.words) for entry in self.entries
                if entry.kind == "event" and entry.words.startswith((f"kill -9 {robot}", f"SIGSTOP {robot} "))]

    def asks(self) -> list[Ask]:
        """All that was asked for, with its ends."""
        return [dataclasses.replace(asking.ask, end_ns=asking.end_ns) for asking in self.askings]

    def before(self, stamp_ns: int, kind: str) -> Entry | None:
        """The last entry of a kind before a moment."""
        earlier = (entry for entry in reversed(self.entries) if entry.kind == kind and entry.stamp_ns <= stamp_ns)
        return next(earlier, None)

    def keep(self, path: Path) -> None:
        """Write it down as JSON lines."""
        rows = [{"stamp_ns": e.stamp_ns, e.kind: e.words} for e in self.entries]
        rows += [{"stamp_ns": a.begin_ns, "ask": dataclasses.asdict(a)} for a in self.asks()]
        rows.sort(key=lambda row: int(str(row["stamp_ns"])))
        path.write_text("".join(f"{json.dumps(row)}\n" for row in rows))
