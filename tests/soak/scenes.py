"""What the robots do while the storm rages: moving, homing, in effort mode, following.

A scene is begun by the person, watched while an event strikes, and kept going: what has ended restarts by commands.
"""

from __future__ import annotations

import random
import signal
import subprocess
import sys
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from procs.arm_types import ARM_TYPES
from shm.clock import pause
from tests.soak import puppets
from tests.soak.diary import Asking, Diary
from tests.soak.person import CONSOLE, MASTER, SLAVE, TELEOP, TROUBLES, StormPerson
from tests.soak.system import System, wait_for
from tools.arms import HOMED
from tools.examples.operator_sim import SeenRecord
from tools.systems import ROOT

RENEWED_S = 0.1
SETTLING_S = 0.15  # a joint that was pushed at its limit of speed swings out when the arm holds
SETTLING_NS = round(SETTLING_S * 1e9)
LASTS_NS = round((RENEWED_S + SETTLING_S) * 1e9)
PUSHES = ("effort", "wrench")
STARTING_S = 5.0
MASTER_SHARE = 0.3
EFFORT_MODE = 3
SPEEDS = {SLAVE: ARM_TYPES["PSM"].efforts.speed, MASTER: ARM_TYPES["MTM"].efforts.speed}


class Scene(Protocol):
    """One way to be busy; so many `events` at most, before the next one has its turn; whom they hit more often."""

    name: str
    events: int
    victims: Sequence[str]

    def keep(self) -> str:
        """Begin, or restart what has ended; returns what is in the way, empty: all is well."""

    def client_event(self) -> str:
        """Something happens to a client; in words, empty: there is none."""

    def end(self) -> None:
        """The person puts everything down."""


class Puppet:
    """A program of a user that drives the slave; what it asks for is open while it lives."""

    def __init__(self, system: System, diary: Diary, kind: str, seed: int) -> None:
        self.kind, self._diary = kind, diary
        self._asking = self._ask()
        words = [sys.executable, "-m", "tests.soak.puppets", kind, system.name, SLAVE, str(seed)]
        if kind == "joints":
            seen = SeenRecord(system.name, SLAVE, "arm")
            file = system.folder / "stream.csv"
            puppets.stream_file(file, np.array(seen.value("setpoint_position")[:6]))
            seen.ring.close()
            words = [sys.executable, "-m", "tools", "stream", SLAVE, str(file), "--rate", "100"]
        self._reported = system.folder / "puppet.txt"
        with self._reported.open("w") as reported:
            self.popen = subprocess.Popen(words, cwd=ROOT, stdout=reported, stderr=reported)
        if kind != "joints":
            wait_for(lambda: self._reported.read_text() or self.popen.poll() is not None, STARTING_S)

    def _ask(self) -> Asking:
        pushes = self.kind in PUSHES
        joints, tip = (SPEEDS[SLAVE], ()) if pushes else puppets.asked(self.kind)
        return self._diary.ask(SLAVE, self.kind, joints, tip=tip, exact=pushes, stream=self.kind != "move")

    @property
    def ended(self) -> str:
        """How it ended, in words; empty while it lives."""
        if self.popen.poll() is None:
            return ""
        self._asking.close()
        return f"{self.kind} ended with {self.popen.returncode}: {self._reported.read_text()[-300:].strip()}"

    def kill(self) -> None:
        """kill -9. A move that is under way may be finished, efforts last a moment; everything else is over."""
        self.popen.kill()
        self.popen.wait()
        if self.kind != "move":
            self._asking.close(LASTS_NS if self.kind in PUSHES else 0)

    def hold_up(self, length_s: float) -> None:
        """SIGSTOP, and SIGCONT later. Efforts and poses that are not renewed are over soon.

        What it was about to send it still sends when it goes on: one more push.
        """
        self.popen.send_signal(signal.SIGSTOP)
        pause(min(length_s, RENEWED_S))
        is_over = length_s > RENEWED_S and self.kind in ("pose", *PUSHES)
        if is_over:
            self._asking.close(SETTLING_NS if self.kind in PUSHES else 0)
        pause(max(0.0, length_s - RENEWED_S))
        if is_over and self.kind in PUSHES:
            self._ask().close(LASTS_NS)
        self.popen.send_signal(signal.SIGCONT)


class Driven:
    """The slave is driven by a program, of `kinds`."""

    events = 12
    victims: Sequence[str] = (SLAVE,)

    def __init__(self, name: str, kinds: Sequence[str], system: System, person: StormPerson, diary: Diary,
                 chance: random.Random) -> None:
        self.name, self._kinds = name, kinds
        self._system, self._person, self._diary, self._chance = system, person, diary, chance
        self._puppet: Puppet | None = None

    def keep(self) -> str:
        """See Scene."""
        puppet = self._puppet
        if puppet is not None and not puppet.ended:
            return ""
        if puppet is not None:
            self._diary.note("client", puppet.ended)
        problems = self._person.bring(HOMED, (SLAVE,))
        if problems:
            return str(problems)
        self.still()  # a move may go on, efforts may last
        refused = self._person.report(SLAVE, "trajectory_j/set_ratio", (puppets.RATIO,))
        if refused:
            return refused
        kind = self._chance.choice(list(self._kinds))
        if kind == "pose" and (refused := self._centre()):
            return refused
        try:
            self._puppet = Puppet(self._system, self._diary, kind, self._chance.randrange(1 << 30))
        except TROUBLES as problem:
            return str(problem)
        return ""

    def _centre(self) -> str:
        """Go where poses are within reach: at its edge an arm turns instead (docs/decisions/0012-at-a-limit.md)."""
        asking = self._diary.ask(SLAVE, "to the centre", puppets.asked("move")[0])
        try:
            return self._person.finish(SLAVE, "move_jp", puppets.PLACE.tolist())
        finally:
            asking.close()

    def still(self) -> None:
        """Hold, and what was asked before is over."""
        self._person.report(SLAVE, "hold")
        self._diary.void([SLAVE])

    def client_event(self) -> str:
        """See Scene."""
        puppet = self._puppet
        if puppet is None or puppet.popen.poll() is not None:
            return ""
        if self._chance.random() < 0.5:
            self._diary.note("event", f"kill -9 the client ({puppet.kind})")
            puppet.kill()
            return f"kill -9 the client ({puppet.kind})"
        length_s = self._chance.uniform(0.05, 2.0)
        self._diary.note("event", f"SIGSTOP the client ({puppet.kind}) {length_s * 1e3:.0f} ms")
        puppet.hold_up(length_s)
        return f"SIGSTOP the client ({puppet.kind}) {length_s * 1e3:.0f} ms"

    def end(self) -> None:
        """See Scene."""
        if self._puppet is not None:
            self._puppet.kill()
            self._puppet = None
        self.still()


class Effort(Driven):
    """The same with programs that push; the master is free in a hand, if it is homed or homed now and then."""

    victims: Sequence[str] = (SLAVE, MASTER)

    def keep(self) -> str:
        """See Scene."""
        is_free, is_homed = self._master()
        if not is_free:
            self._person.stand_up()
        reported = super().keep()
        if reported or self._person.drawing is not None or not (is_homed or self._chance.random() < MASTER_SHARE):
            return reported
        problems = self._person.bring(HOMED, (MASTER,))
        return str(problems) if problems else self._person.take_master(SPEEDS[MASTER])

    def _master(self) -> tuple[bool, bool]:
        """In effort mode, homed."""
        try:
            seen = SeenRecord(self._system.name, MASTER, "arm")
            is_homed = seen.value("state") == "ENABLED" and bool(seen.value("is_homed"))
            is_free = is_homed and int(seen.value("control_mode")) == EFFORT_MODE
            seen.ring.close()
        except TROUBLES:
            return False, False
        return is_free, is_homed

    def end(self) -> None:
        """See Scene."""
        self._person.stand_up()
        super().end()


class Homing:
    """Both arms lose power by a command, and are homed again; that goes on while the event strikes."""

    name, events = "homing", 10
    victims: Sequence[str] = (SLAVE, MASTER, "system")

    def __init__(self, person: StormPerson, diary: Diary, chance: random.Random) -> None:
        self._person, self._diary, self._chance = person, diary, chance
        self._askings: list[Asking] = []

    def keep(self) -> str:
        """See Scene."""
        self.end()
        self._askings = self._person.homing()
        refused = self._person.everything("home")
        if refused:
            return refused
        pause(self._chance.uniform(0.0, 4.0))
        return ""

    def client_event(self) -> str:
        """See Scene."""
        return ""

    def end(self) -> None:
        """See Scene; what homes still, goes on until it is told not to."""
        self._person.disable()
        for asking in self._askings:
            asking.close()
        self._askings = []


class Following:
    """A hand draws on the master, the slave follows."""

    name, events = "following", 10
    victims: Sequence[str] = (TELEOP, CONSOLE, SLAVE, MASTER)

    def __init__(self, person: StormPerson) -> None:
        self._person = person

    def keep(self) -> str:
        """See Scene."""
        drawing = self._person.drawing
        if drawing is not None and not drawing.reason:
            return ""
        self._person.stand_up()
        problems = self._person.bring(HOMED)
        return str(problems) if problems else self._person.sit_down(SPEEDS[MASTER])

    def client_event(self) -> str:
        """See Scene."""
        return ""

    def end(self) -> None:
        """See Scene."""
        self._person.stand_up()
