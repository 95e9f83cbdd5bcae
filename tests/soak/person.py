"""Who sits at the robot: brings it back by commands, one after the other, and writes down what was asked for and when.

Nothing else in a storm powers, homes or moves a robot; hands and feet at the emulated boards are no commands.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Sequence

import numpy as np

from tests.soak.diary import Asking, Diary
from tests.soak.system import System
from trocar.procs.tables.arm_types import ARM_TYPES
from trocar.procs.tables.bring_up import DISABLED, HOMED
from trocar.shm.mailbox.client import MailboxFull
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.client.bring_up import ArmBringUp
from trocar.tools.client.remote import Remote
from trocar.tools.examples.hand import Hand, figure_eight
from trocar.tools.examples.operator_sim import OperatorSim
from trocar.tools.inspect.watch import Amplifiers, Watch
from trocar.tools.output.errors import Problem, Refused

TROUBLES = (Problem, Refused, SegmentError, MailboxFull, KeyError)
MASTER, SLAVE, CONSOLE, TELEOP = "MTMR", "PSM1", "console", "MTMR_PSM1"
ROBOTS = (MASTER, SLAVE)
SIZE_M, TURN_S, RAMP_S, BEAT_S = 0.04, 8.0, 1.0, 0.01
FURTHEST_M = 0.015  # further behind, and a person stops pulling
RELAX_NS = 800_000_000  # what was pulled away from where it is held goes back when it is let go
LEFT_S = 0.4  # longer than pedals are debounced: the console sees that nobody is there
POWERING = ("enable", "home")
PATIENCE_S = 20.0  # a homing that a stall has ended is asked for again


class Commands(Remote):
    """Commands to one component; those that may power its robot are written down."""

    def __init__(self, system: str, instance: str, diary: Diary) -> None:
        super().__init__(system, instance)
        self._diary = diary

    def send(self, command: str, values: Sequence[float] = (), text: str = "") -> int:
        """See Remote."""
        if command == "state_command":
            robots = (self.instance,) if text in POWERING and self.instance in ROBOTS else ()
            self._diary.command(robots, f"{self.instance} {text}")
        return super().send(command, values, text)


class StormPerson:
    """Commands to a running system; `problem` words come from its own answers."""

    def __init__(self, system: System, diary: Diary) -> None:
        self._system, self._diary = system, diary
        self.drawing: Drawing | None = None

    def report(self, instance: str, command: str, values: Sequence[float] = (), text: str = "") -> str:
        """Give a command; returns why it was not carried out, empty: it was."""
        try:
            with Commands(self._system.name, instance, self._diary) as remote:
                reply = remote.answered(command, values, text)
        except TROUBLES as problem:
            return str(problem)
        return "" if reply.outcome in ("accepted", "done") else reply.text or reply.outcome

    def finish(self, instance: str, command: str, values: Sequence[float]) -> str:
        """Give a command and wait for its end; returns why it was not carried out, empty: it was."""
        try:
            with Commands(self._system.name, instance, self._diary) as remote:
                reply = remote.settled(command, values)
        except TROUBLES as problem:
            return str(problem)
        return "" if reply.outcome == "done" else reply.text or reply.outcome

    def everything(self, word: str) -> str:
        """Ask the system for power or homing of all arms, without waiting for it."""
        self._diary.command(ROBOTS, f"system {word}")
        return self.report("system", word)

    def homing(self, robots: Sequence[str] = ROBOTS) -> list[Asking]:
        """Robots may home from now on: as fast as their joints go at most."""
        return [self._diary.ask(robot, "homing", ARM_TYPES[robot[:3]].moves.velocity) for robot in robots]

    def bring(self, goal: str, robots: Sequence[str] = ROBOTS) -> dict[str, str]:
        """Bring arms to a goal (HOMED, DISABLED); what is wrong with each that did not get there."""
        system = self._system.name
        asking = self.homing(robots) if goal == HOMED else []
        try:
            with contextlib.ExitStack() as stack:
                watches = [stack.enter_context(Watch(system, robot)) for robot in robots]
                bring_ups = [ArmBringUp(watch, stack.enter_context(Commands(system, watch.name, self._diary)),
                                        stack.enter_context(Amplifiers(system, watch.name)), goal,
                                        PATIENCE_S, simulated=False) for watch in watches]
                while not all(bring_up.over for bring_up in bring_ups):
                    for bring_up in bring_ups:
                        if not bring_up.over:
                            bring_up.step()
                    pause(0.02)
                return {bring_up.watch.name: bring_up.problem for bring_up in bring_ups if bring_up.problem}
        except TROUBLES as problem:
            return dict.fromkeys(robots, str(problem))
        finally:
            for each in asking:
                each.close()

    def disable(self) -> None:
        """Take power from both arms."""
        self.bring(DISABLED)

    def sit_down(self, speed_limit: Sequence[float]) -> str:
        """Follow: enable, pedal, pinch, draw; returns what keeps it from following, empty: it follows.

        `speed_limit` is that of the master in effort mode.
        """
        self.stand_up()
        self._diary.command(ROBOTS, "console teleop_enable")
        # the master is aligned by moves, and then free in a hand
        asking = [self._diary.ask(MASTER, "align and follow",
                                  np.maximum(ARM_TYPES["MTM"].moves.velocity, speed_limit).tolist(), voidable=False),
                  self._diary.ask(SLAVE, "follow", leader=MASTER, scale=0.2, voidable=False)]
        self.drawing = Drawing(self._system, asking)
        return self.drawing.begin()

    def take_master(self, speed_limit: Sequence[float]) -> str:
        """Free the master and draw with it, nobody follows."""
        self.stand_up()
        refused = self.report(MASTER, "body/servo_cf", (0.0,) * 6)
        if refused:
            return refused
        asking = [self._diary.ask(MASTER, "effort, in a hand", speed_limit, exact=True, voidable=False)]
        self.drawing = Drawing(self._system, asking)
        return self.drawing.begin(follow=False)

    def stand_up(self) -> None:
        """Let go of the master, leave the pedals, want no teleoperation, have the master stay where it is."""
        if self.drawing is None:
            return
        self.report(CONSOLE, "teleop_enable", (0.0,))
        self.report(MASTER, "hold")
        self.drawing.end()
        self.drawing = None
        pause(LEFT_S)


class Drawing:
    """A hand that draws eights at the master, in a thread; it waits where the master does not come along."""

    def __init__(self, system: System, askings: Sequence[Asking]) -> None:
        self._system, self._askings = system, askings
        self._over = threading.Event()
        self._thread: threading.Thread | None = None
        self._stack = contextlib.ExitStack()
        self.passed_s = 0.0

    def begin(self, *, follow: bool = True) -> str:
        """Take the master, and begin; what keeps it from following."""
        name = self._system.name
        try:
            seat = self._stack.enter_context(OperatorSim(name, CONSOLE))
            self._hand = self._stack.enter_context(Hand(name, seat, seat.teleops[0]))
            self._teleop = seat.teleops[0]
            self._seen = directory.reader(name, MASTER, "state", "arm")
            self._stack.callback(self._seen.close)
            if follow:
                self._hand.begin()
            self._hand.take()
        except TROUBLES as problem:
            return str(problem)
        self._thread = threading.Thread(target=self._draw, daemon=True)
        self._thread.start()
        return ""

    @property
    def reason(self) -> str:
        """Why it does not follow, empty: it does."""
        try:
            return "" if self._teleop.is_following else self._teleop.reported
        except TROUBLES as problem:
            return str(problem)

    def follows_no_more(self) -> None:
        """Somebody else has ended it: the slave is to stand, the master stays in the hand."""
        for asking in self._askings[1:]:
            asking.close()

    def _draw(self) -> None:
        tip = self._seen.field("local_measured_cp")
        offset = np.zeros(3)
        while not self._over.wait(BEAT_S):
            with contextlib.suppress(*TROUBLES):
                whole = self._seen.newest()
                fresh = whole and monotonic_ns() - self._seen.stamp_ns < 50_000_000
                if fresh and np.linalg.norm(tip[:3] - self._hand.place[:3] - offset) < FURTHEST_M:
                    self.passed_s += BEAT_S
                    size = SIZE_M * min(1.0, self.passed_s / RAMP_S)
                    offset = figure_eight(2.0 * np.pi * self.passed_s / TURN_S, size)
                self._hand.draw(offset)

    def end(self) -> None:
        """Let go; what was asked for is over."""
        self._over.set()
        if self._thread is not None:
            self._thread.join()
        with contextlib.suppress(*TROUBLES):
            self._stack.close()
        for asking in self._askings:
            asking.close(RELAX_NS)
