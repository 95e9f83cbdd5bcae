"""The robot of an environment as a running system: a real one, emulated boards or KINEMATIC arms, on any clock.

It commands motions of arms that a person has powered and homed, and nothing else: it never enables, homes, resumes or
clears. All its commands are one command of the person who made it: none is executed after a fault.
"""

from __future__ import annotations

import contextlib
import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final, NoReturn

from trocar.procs.document.system import SystemConfig
from trocar.procs.kinematics.poses import Array, angle_between, matrix_from_pose
from trocar.procs.rl.backend import RobotBackend, RobotStopped
from trocar.procs.rl.link import ArmLink
from trocar.procs.rl.model import ArmModel, StartPose
from trocar.procs.rl.others import OtherCommands, Way
from trocar.shm.commands import became
from trocar.shm.mailbox.client import Client, MailboxFull, begin
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import directory
from trocar.shm.time.clock import boottime_ns
from trocar.shm.time.system_time import LOCKSTEP, SystemTime
from trocar.tools.inspect.watch import arm_names, document_of
from trocar.tools.output.errors import Problem
from trocar.tools.systems.find import chosen_system

Pair = tuple[float, float]

GAP_NS: Final = 100_000_000
"""Setpoints later than this are no longer part of a stream; the arm has the same limit."""
STANDS_S: Final = 10.0
"""Maximum time for which a system's time may be stopped."""
MOVE_S: Final = 12.0
"""A move at full speed takes less; at a tenth of it, less than ten times as much."""
POLL_S: Final = 0.01
SHOWN, SHOWN_S = 50, 0.1
"""Number of looks at a record until it shows a change, and their interval while the system's time is stopped."""
RATIOS: Final = ("trajectory_j/set_ratio_v", "trajectory_j/set_ratio_a")
FRESH_NS: Final = 200_000_000
BASE_M, BASE_RAD = 0.001, 0.01
"""Tremble of an arm's base on setup joints; a base that moves further is being moved."""
SLOWEST_RATIO, FASTEST_RATIO = 0.01, 0.5


@dataclass(frozen=True, slots=True)
class RunningSystem:
    """The running system that an environment commands. It can be pickled.

    `system`: default: TROCAR_SYSTEM, else the only running system. `arms`: names of the arms, default: those of the
    task. `reset_ratio`: speed and acceleration of the moves to start poses, as a fraction of the arms' limits (0.01 to
    0.5).
    """

    system: str = ""
    arms: tuple[str, ...] = ()
    reset_ratio: float = 0.1

    def __post_init__(self) -> None:
        if isinstance(self.arms, str):
            raise TypeError(f"arms is {self.arms!r}; allowed: names, as ({self.arms!r},)")
        if not SLOWEST_RATIO <= self.reset_ratio <= FASTEST_RATIO:
            raise ValueError(f"reset_ratio is {self.reset_ratio:g}; allowed: {SLOWEST_RATIO:g} to {FASTEST_RATIO:g}")


class AttachedRobot(RobotBackend):
    """Arms of a running system."""

    def __init__(self, where: RunningSystem, kind: str, arms: Sequence[str], jaws: Sequence[float]) -> None:
        """`kind`: the type of all arms; `arms`: unless others are named; `jaws`: of the starts.

        RobotStopped if an arm is not powered and homed, Problem if there is none, ValueError: it is of another kind.
        """
        self._system, self._ratio = chosen_system(where.system or os.environ.get("TROCAR_SYSTEM")), where.reset_ratio
        self._stopped = ""
        try:
            names = arm_names(self._system, where.arms or arms)
        except Problem as problem:
            if where.arms:
                raise
            raise Problem(f"{problem} (other arms: backend=RunningSystem(arms=…))") from None
        types = [document_of(self._system).arm(name).type for name in names]
        if types != [kind] * len(jaws) or len(set(names)) < len(jaws):
            given = ", ".join(f"{name} ({type_})" for name, type_ in zip(names, types, strict=True))
            raise ValueError(f"arms are {given}; it takes {len(jaws)} different {kind}")
        with contextlib.ExitStack() as stack:
            self._time = stack.enter_context(SystemTime(self._system))
            if self._time.clock == LOCKSTEP:
                raise Problem(f"{self._system} is in lock-step, whose time does not wait for this program; start it "
                              "with --clock paced")
            self._gap_ns: Callable[[], int] = self._time.now_ns if self._time.simulated else boottime_ns
            self._others: list[OtherCommands] = []
            self.links: Sequence[ArmLink] = [self._attached(name, stack) for name in names]
            self.models: Sequence[ArmModel] = [self._model(document_of(self._system), link, jaw)
                           for link, jaw in zip(self.links, jaws, strict=True)]
            self._bases = [link.base for link in self.links]
            self._first_bases = list(self._bases)
            self.frame = self.links[0].frame
            if len(frames := {link.frame for link in self.links}) > 1:
                raise Problem(f"{', '.join(names)} report their poses in different frames: {', '.join(sorted(frames))}")
            self._held = stack.pop_all()
        self._ways = [Way(model) for model in self.models]
        self._due_ns: int | None = None
        """When the next setpoint is due, on the clock that shows gaps; None: no stream is under way."""
        self._is_asking, self._asked = False, 0
        """A command without a final reply is under way; its number, 0 while it is being sent."""

    def _attached(self, name: str, stack: contextlib.ExitStack) -> ArmLink:
        reader = stack.enter_context(contextlib.closing(directory.reader(self._system, name, "state")))
        client = stack.enter_context(contextlib.closing(Client(self._system, name)))
        client.on_behalf(own := begin(self._system))
        audit = stack.enter_context(contextlib.closing(directory.reader(self._system, name, "audit")))
        self._others.append(OtherCommands(audit, own.id))
        link = ArmLink(name, reader, client)
        link.look()
        if why := link.problem:
            raise RobotStopped(f"{why}; first: trocar home {name}")
        return link

    @staticmethod
    def _model(document: SystemConfig, link: ArmLink, jaw: float) -> ArmModel:
        return ArmModel(document.arm(link.name), link.carried, matrix_from_pose(link.base), jaw)

    def look(self, number: int) -> str:
        """See RobotBackend.

        An arm gets no commands if its state is not updated, others command or move it, or its base has moved.
        """
        link, model = self.links[number], self.models[number]
        link.look()
        if self.now_ns() - link.stamp_ns > FRESH_NS:
            return f"{link.name} no longer publishes its state"
        if link.problem:
            return link.problem
        if asked := self._others[number].look():
            return f"{link.name} received {asked}"
        if why := self._otherwise(number):
            return why
        if (base := link.base).tobytes() != self._bases[number].tobytes():
            self._bases[number] = base
            model.base[...] = matrix_from_pose(base)
        first = self._first_bases[number]
        if math.dist(base[:3], first[:3]) > BASE_M or angle_between(base, first) > BASE_RAD:
            return f"the base of {link.name} has moved since the environment was made"
        return f"poses of {link.name} are now in {link.frame}, not {self.frame}" if link.frame != self.frame else ""

    def _otherwise(self, number: int) -> str:
        """Changes to an arm that we did not command; its clutch, for example, leaves no trace in the audit."""
        link, model, way = self.links[number], self.models[number], self._ways[number]
        if link.carried != model.carried:
            return f"{link.name} carries {link.carried or 'nothing'}, no longer {model.carried}"
        if not way.has_begun:
            return ""
        if link.is_busy:
            return f"{link.name} is {link.doing}, which we did not request"
        far = way.objection(model.vector(*link.setpoint(model.count)))
        return f"{link.name} was moved by another program: {far} from its requested position" if far else ""

    def now_ns(self) -> int:
        """The system's time."""
        return self._time.now_ns()

    def heads_for(self, number: int, joints: Array, jaw: float) -> None:
        self._ways[number].add(self.models[number].vector(joints, jaw), self.now_ns())

    def begin(self, number: int, starts: Sequence[StartPose], seed: int) -> None:
        """See RobotBackend: a slow move of all joints, of one arm after the other. RobotStopped after a fault."""
        self.check()
        self._due_ns = None
        for others, way in zip(self._others, self._ways, strict=True):
            others.begin()
            way.forget()
        for number, (start, model) in enumerate(zip(starts, self.models, strict=True)):
            link = self.links[number]
            if why := self.look(number):
                self._give_up(why)
            if link.is_busy:
                raise RobotStopped(f"{link.name} is {link.doing}, which we did not request; begin once it is at rest")
            self._slowly(number, start, model.has_jaw)
            self._stands(number)
        self.check()
        self._due_ns = None  # a learner may take its time before the first step

    def _slowly(self, number: int, start: StartPose, has_jaw: bool) -> None:
        """However it ends, no move of ours continues, and none gets faster; a person's slower setting is restored."""
        link = self.links[number]
        before = link.ratios
        pace = min(self._ratio, before[0]), min(self._ratio, before[1])
        try:
            for command, ratio in zip(RATIOS, pace, strict=True):
                self._done(number, command, (ratio,), before)
            self._shown(number, lambda: link.ratios == pace)
            self._done(number, "move_jp", tuple(start.joints), pace)
            if has_jaw:
                self._done(number, "jaw/move_jp", (start.jaw,), pace)
        finally:
            with contextlib.suppress(MailboxFull, SegmentError):
                if self._is_asking and not link.hear(self._asked):
                    link.send("hold")
                self._is_asking = False
                self._give_back(number, before, pace)

    def _give_back(self, number: int, before: Pair, pace: Pair) -> None:
        """Restore earlier ratios unless changed since; wait, as the next reset takes current ones for a person's."""
        link, asked = self.links[number], 0

        def is_back() -> bool:
            return not any(now == ours != was for was, ours, now in zip(before, pace, link.ratios, strict=True))

        link.look()
        for command, was, ours, now in zip(RATIOS, before, pace, link.ratios, strict=True):
            if now in (was, ours):
                asked = link.send(command, (was,))
        if asked and not (self._shown(number, lambda: bool(link.hear(asked))) and self._shown(number, is_back)):
            self.stop(f"{link.name} does not get its trajectory ratio of {before[0]:g} back")

    def _stands(self, number: int) -> None:
        """The record shows the end of our move: the arm continues from there, or not at all."""
        link, model = self.links[number], self.models[number]
        if not self._shown(number, lambda: not link.is_busy):
            self._give_up(f"{link.name} is {link.doing}, which we did not request")
        self._ways[number].begin(model.vector(*link.setpoint(model.count)))

    def _shown(self, number: int, what: Callable[[], bool]) -> bool:
        """Wait, not long, until an arm's record shows something; False: it does not."""
        self._due_ns = None  # no stream is under way
        for _ in range(SHOWN):
            self.links[number].look()
            if what():
                return True
            self._time.pause(POLL_S, SHOWN_S)
        return False

    def _done(self, arm: int, command: str, values: tuple[float, ...], pace: Pair) -> None:
        """Send, and wait for the end; RobotStopped if it fails, or if ratios become larger than `pace`."""
        link = self.links[arm]
        self._keeps_slow(arm, pace)
        link.forget()
        self._is_asking, self._asked = True, 0
        try:
            self._asked = link.send(command, values)
        except (MailboxFull, SegmentError) as error:
            self._give_up(str(error))
        limit_s = MOVE_S / min(self._ratio, *pace)
        end_ns = self.now_ns() + round(limit_s * 1e9)
        while not (ended := link.hear(self._asked)):
            self._keeps_slow(arm, pace)
            if self.now_ns() > end_ns:
                self._give_up(f"{link.name}: {command} is not done after {limit_s:g} s")
            self.wait_until(self.now_ns() + round(POLL_S * 1e9))
        self._is_asking = False
        if ended != "done":
            if why := self.look(arm):
                self._give_up(why)
            self._give_up(f"{link.name}: {command} {became(ended)}: {link.refusal}")

    def _keeps_slow(self, arm: int, pace: Pair) -> None:
        self.keeps_pace(round(POLL_S * 1e9))
        link = self.links[arm]
        if any(ratio > allowed for ratio, allowed in zip(link.ratios, pace, strict=True)):
            ratio = max(link.ratios)
            self._give_up(f"another program set the trajectory ratio of {link.name} to {ratio:g} during our move")

    def wait_until(self, deadline_ns: int) -> None:
        """See RobotBackend. RobotStopped if we, or the system's time, were stalled."""
        self.check()
        try:
            self._time.pause_until(deadline_ns, STANDS_S)
        except KeyboardInterrupt:
            self._hold()
            raise
        if self.now_ns() < deadline_ns:
            self._give_up(f"the system's time has stood still for {STANDS_S:g} s")

    def keeps_pace(self, period_ns: int) -> None:
        """See RobotBackend. Checks all arms each time: a moved base is known within 20 ms, without a jump."""
        self.check()
        for number in range(len(self.links)):
            if why := self.look(number):
                self._give_up(why)
        now_ns = self._gap_ns()
        late_ns = 0 if self._due_ns is None else now_ns - self._due_ns
        self._due_ns = now_ns + period_ns
        if late_ns > GAP_NS:
            self._give_up(f"this program stalled for {late_ns * 1e-9:.2f} s")

    def check(self) -> None:
        if self._stopped:
            raise RobotStopped(self._stopped)

    def stop(self, why: str) -> None:
        """See RobotBackend: from now on everything raises RobotStopped."""
        if not self._stopped:
            self._hold()
            self._stopped = (f"this environment has ended: {why}. Look at the robot (trocar status), "
                             "home it where it is not homed (trocar home), then make a new environment")

    def _give_up(self, why: str) -> NoReturn:
        self.stop(why)
        raise RobotStopped(self._stopped)

    def _hold(self) -> None:
        """Hold all arms that can hold, unless others command them now; what a person does with one is not paused."""
        for link, others in zip(self.links, self._others, strict=True):
            if not link.is_ready or link.doing != "moving" or others.look():
                continue
            with contextlib.suppress(MailboxFull, SegmentError):
                link.send("hold")

    def close(self) -> None:
        """See RobotBackend: the arms hold, unless others may already command them."""
        if not self._stopped and self._due_ns is not None and self._gap_ns() - self._due_ns < GAP_NS:
            self._hold()
        self._stopped = self._stopped or "this environment is closed"
        self._held.close()
