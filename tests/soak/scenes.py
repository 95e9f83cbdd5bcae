"""What the robots do while the storm rages: moving, homing, in effort mode, following.

A scene is begun by the person, watched while an event strikes, and kept going: what has ended restarts by commands.
"""

from __future__ import annotations

import collections
import contextlib
import random
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from tests.soak import puppets
from tests.soak.diary import Asking, Diary
from tests.soak.judge import Attempt
from tests.soak.motion import WINDOW, bounds
from tests.soak.person import CONSOLE, MASTER, ROBOTS, SLAVE, TELEOP, TROUBLES, StormPerson
from tests.soak.system import System, wait_for
from trocar.procs.machine.paths import ROOT
from trocar.procs.tables.arm_types import ARM_TYPES
from trocar.procs.tables.bring_up import HOMED
from trocar.procs.tables.manifest import proc
from trocar.procs.teleop.motion_check import STEP_M, STEP_RAD
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.client.remote import Remote
from trocar.tools.examples.operator_sim import SeenRecord

BOUNDS = {robot: bounds(robot[:3]).tolist() for robot in (SLAVE, MASTER)}
CLIENT_SHARE = 0.5
RENEWED_S = 0.1
SETTLING_S = 0.15  # a joint that was pushed at its limit of speed swings out when the arm holds
SETTLING_NS = round(SETTLING_S * 1e9)
WRONG_NS = 150_000_000  # goals that are wrong and still followed, within the bounds of streams
WINDOW_S = WINDOW * proc("boards").period_s
SMALL_JUMP = 300  # counts: a hand might have moved so far, and the slave follows
FOLLOWED_STEP = STEP_M / WINDOW_S, STEP_RAD / WINDOW_S  # m/s, rad/s: the largest such step within one window
STEPS_M = 0.003, 0.03  # of base frames: one that is followed, one that ends streams
ENDING_S = 0.2  # that a program takes to end
INTRUSION_S, INTRUSION_RAD_S, FAR_RAD = 0.5, 0.1, 0.8
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
    client_share: float  # of its events, where there is one
    victims: Sequence[str]

    def keep(self) -> str:
        """Begin, or restart what has ended; returns what is in the way, empty: all is well."""

    def client_events(self) -> Mapping[str, Callable[[], str]]:
        """What may happen to clients and by them now, by name; each does it and says it in words."""

    def end(self) -> None:
        """The person puts everything down."""


def _setpoint(system: System) -> puppets.Array:
    """The slave's, of all joints but the jaw."""
    seen = SeenRecord(system.name, SLAVE, "arm")
    try:
        return np.array(seen.value("setpoint_position")[:6])
    finally:
        seen.ring.close()


class Puppet:
    """A program of a user that drives the slave; what it asks for is open while it lives."""

    def __init__(self, system: System, diary: Diary, kind: str, seed: int) -> None:
        self.kind, self._diary = kind, diary
        self._asking = self._ask()
        words = [sys.executable, "-m", "tests.soak.puppets", kind, system.name, SLAVE, str(seed)]
        first = _setpoint(system)
        if kind == "joints":
            file = system.folder / "stream.csv"
            puppets.stream_file(file, first)
            words = [sys.executable, "-m", "trocar", "stream", SLAVE, str(file), "--rate", "100"]
        self._reported = system.folder / "puppet.txt"
        with self._reported.open("w") as reported:
            self.popen = subprocess.Popen(words, cwd=ROOT, stdout=reported, stderr=reported)
        begins = (lambda: np.any(_setpoint(system) != first)) if kind == "joints" else self._reported.read_text
        wait_for(lambda: begins() or self.popen.poll() is not None, STARTING_S)

    def _ask(self) -> Asking:
        pushes = self.kind in PUSHES
        joints, tip = (SPEEDS[SLAVE], ()) if pushes else puppets.asked(self.kind)
        return self._diary.ask(SLAVE, self.kind, joints, tip=tip, exact=pushes, stream=self.kind != "move",
                               settling_ns=SETTLING_NS if pushes else 0)

    @property
    def printed(self) -> str:
        """Its last line."""
        return self._reported.read_text().strip().rpartition("\n")[2]

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
            self._asking.close(LASTS_NS if self.kind in PUSHES else None)

    def hold_up(self, length_s: float) -> None:
        """SIGSTOP, and SIGCONT later. Efforts and poses that are not renewed are over soon.

        What it was about to send it still sends when it goes on: one more push.
        """
        self.popen.send_signal(signal.SIGSTOP)
        pause(min(length_s, RENEWED_S))
        is_over = length_s > RENEWED_S and self.kind in ("pose", *PUSHES)
        if is_over:
            self._asking.close()
        pause(max(0.0, length_s - RENEWED_S))
        if is_over and self.kind in PUSHES:
            self._ask().close(LASTS_NS)
        self.popen.send_signal(signal.SIGCONT)


@dataclass
class Others:
    """Other programs, which do to robots what they should not."""

    system: System
    person: StormPerson
    diary: Diary
    chance: random.Random

    def hold(self, robot: str, stopped: Sequence[str]) -> str:
        """A third program stops a robot, and with it those that are `stopped`."""
        words = f"hold {robot} by a third program"
        self.diary.note("event", words)
        refused = self.person.report(robot, "hold")
        if not refused:
            self.diary.stop(stopped, words)
        return f"{words} ({refused})" if refused else words

    def stream(self, puppet: Puppet) -> str:
        """A second program streams into a running stream: slowly away from where the arm is, or far off.

        None of its goals is taken while the first one goes on.
        """
        is_far = self.chance.random() < 0.5
        words = f"a second program streams servo_jp, {'far off' if is_far else 'slowly'}"
        self.diary.wrong(SLAVE, words)
        asking = None if is_far else self.diary.ask(SLAVE, words, [INTRUSION_RAD_S] * len(BOUNDS[SLAVE]))
        outcomes = collections.Counter[str]()
        with contextlib.suppress(*TROUBLES), Remote(self.system.name, SLAVE) as arm:
            first, begin_ns = _setpoint(self.system), monotonic_ns()
            while (passed_s := (monotonic_ns() - begin_ns) * 1e-9) < INTRUSION_S:
                off = FAR_RAD if is_far else INTRUSION_RAD_S * passed_s
                arm.send("servo_jp", first - [off, 0.0, 0.0, 0.0, 0.0, 0.0])
                outcomes.update(reply.outcome for reply in arm.replies())
                pause(0.01)
        if asking is not None:
            asking.close()
        pause(ENDING_S)
        if outcomes["done"] and puppet.kind in puppets.STREAMS and not puppet.ended:
            self.diary.attempts.append(Attempt(SLAVE, monotonic_ns(), words, "done"))
        return f"{words}: {dict(outcomes)}"

    def step_base(self) -> str:
        """The slave's base frame becomes another one, and the first one again."""
        step = self.chance.choice(STEPS_M)
        words = f"base frame of {SLAVE} {step * 1e3:g} mm off"
        try:
            seen = SeenRecord(self.system.name, SLAVE, "arm")
            base, frame = np.array(seen.value("base_frame")), str(seen.value("reference_frame"))
            seen.ring.close()
        except TROUBLES as problem:
            return f"{words}: {problem}"
        self.diary.wrong(SLAVE, words)
        for pose in (base + np.eye(7)[0] * step, base):
            asking = self.diary.ask(SLAVE, words, BOUNDS[SLAVE])
            refused = self.person.report(SLAVE, "set_base_frame", pose.tolist(), frame)
            pause(0.05)
            asking.close()
            pause(self.chance.uniform(0.05, 0.4))
        return f"{words} ({refused})" if refused else words

    def jump(self) -> str:
        """An encoder of the master jumps, and back; held, the master jumps with it, which nobody promises against."""
        axis, counts = self.chance.randint(0, 6), self.chance.choice((SMALL_JUMP, 3000, 20000))
        words = f"encoder_jump {axis} {counts} {MASTER}"
        self.diary.note("event", words)
        asking = self.diary.ask(MASTER, words, (100.0,) * 7, voidable=False)
        followed = [self.diary.ask(SLAVE, words, tip=FOLLOWED_STEP, voidable=False)] if counts == SMALL_JUMP else []
        for sign in (1.0, -1.0):
            self.diary.lose((MASTER,), words)
            refused = self.person.report("boards", "encoder_jump", (axis, sign * counts), MASTER)
            pause(self.chance.uniform(0.1, 0.5))
        for each in (asking, *followed):
            each.close(SETTLING_NS)
        return f"{words} ({refused})" if refused else words


class Driven:
    """The slave is driven by a program, of `kinds`."""

    events, client_share = 12, CLIENT_SHARE
    victims: Sequence[str] = (SLAVE,)

    def __init__(self, name: str, kinds: Sequence[str], system: System, person: StormPerson, diary: Diary,
                 chance: random.Random) -> None:
        self.name, self._kinds = name, kinds
        self._system, self._person, self._diary, self._chance = system, person, diary, chance
        self._puppet: Puppet | None = None
        self._others = Others(system, person, diary, chance)

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

    def client_events(self) -> Mapping[str, Callable[[], str]]:
        """See Scene."""
        puppet = self._puppet
        if puppet is None or puppet.popen.poll() is not None:
            return {}
        found = {"client_kill": lambda: self._kill(puppet), "client_pause": lambda: self._hold_up(puppet),
                 "foreign_hold": lambda: self._others.hold(SLAVE, (SLAVE,))}
        if puppet.kind in puppets.STREAMS:
            found["wrong_numbers"] = lambda: self._numbers(puppet)
            found["base_frame"] = self._others.step_base
        if puppet.kind in ("joints", *puppets.STREAMS):
            found["second_stream"] = lambda: self._others.stream(puppet)
        return found

    def _kill(self, puppet: Puppet) -> str:
        self._diary.note("event", f"kill -9 the client ({puppet.kind})")
        puppet.kill()
        return f"kill -9 the client ({puppet.kind})"

    def _hold_up(self, puppet: Puppet) -> str:
        length_s = self._chance.uniform(0.05, 2.0)
        self._diary.note("event", f"SIGSTOP the client ({puppet.kind}) {length_s * 1e3:.0f} ms")
        puppet.hold_up(length_s)
        return f"SIGSTOP the client ({puppet.kind}) {length_s * 1e3:.0f} ms"

    def _numbers(self, puppet: Puppet) -> str:
        words = f"wrong numbers of the client ({puppet.kind})"
        self._diary.wrong(SLAVE, words)
        asking = self._diary.ask(SLAVE, words, BOUNDS[SLAVE])
        puppet.popen.send_signal(signal.SIGUSR1)
        pause(WRONG_NS * 1e-9)
        asking.close()
        return f"{words}: {puppet.printed}"

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

    name, events, client_share = "homing", 10, 0.0
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

    def client_events(self) -> Mapping[str, Callable[[], str]]:
        """See Scene."""
        return {}

    def end(self) -> None:
        """See Scene; what homes still, goes on until it is told not to."""
        self._person.disable()
        for asking in self._askings:
            asking.close()
        self._askings = []


class Following:
    """A hand draws on the master, the slave follows."""

    name, events, client_share = "following", 10, CLIENT_SHARE
    victims: Sequence[str] = (TELEOP, CONSOLE, SLAVE, MASTER)

    def __init__(self, others: Others, person: StormPerson) -> None:
        self._others, self._person = others, person

    def keep(self) -> str:
        """See Scene."""
        drawing = self._person.drawing
        if drawing is not None and not drawing.reason:
            return ""
        self._person.stand_up()
        problems = self._person.bring(HOMED)
        return str(problems) if problems else self._person.sit_down(SPEEDS[MASTER])

    def client_events(self) -> Mapping[str, Callable[[], str]]:
        """See Scene."""
        if self._person.drawing is None or self._person.drawing.reason:
            return {}
        return {"foreign_hold": self._hold, "base_frame": self._others.step_base,
                "encoder_jump": self._others.jump}

    def _hold(self) -> str:
        master = self._others.chance.random() < 0.5
        words = self._others.hold(*((MASTER, ROBOTS) if master else (SLAVE, (SLAVE,))))
        if self._person.drawing is not None:
            self._person.drawing.follows_no_more()
        return words

    def end(self) -> None:
        """See Scene."""
        self._person.stand_up()
