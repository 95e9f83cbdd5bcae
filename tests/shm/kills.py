"""Kill -9 by the thousand: a small parent forks victims that run the real code of shm/, and looks at what they leave.

A victim dies in one of two ways: by its own hand after a number of bytecode steps inside shm/ (exact, the same for the
same seed), or by the parent's after a number of microseconds (so that it also dies inside a memcpy or a system call).
Either is counted from before it attaches its segments ("early") or from when it has ("late"). The victims themselves,
and what must hold after each death, are in victims.py and senders.py.

Run as a process of its own (`main`), because a fork copies all of its parent. Its arguments: system, victim, kills,
seed, a mistake of wrongs.py to be put in or nothing, and the step at which the first life ends if every later one is to
end STRIDE steps later (a walk through the code), 0 for deaths drawn from the seed. Prints one line of JSON.
"""

from __future__ import annotations

import contextlib
import gc
import json
import os
import random
import signal
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import Any, Protocol

from tests.shm import senders, victims, wrongs
from tests.shm.witness import Notes, RingViolation, die_with_parent, holds
from trocar.shm.memory.parts import remove_all
from trocar.shm.ring import ring

TRACED = (str(Path(ring.__file__).parents[1]) + os.sep, str(Path(__file__).with_name("wrongs.py")))
PATIENCE_NS = 20_000_000_000
STRIDE = 2  # of a walk: between two things that others can see there are more steps of bytecode
LATE_STEPS, LATE_US = 2500, 1500  # how long a victim that has attached goes on at most
UNTIL_KILLED = 1 << 60
STEPS, TIME = "steps", "microseconds"


class Victim(Protocol):
    """One kind of process to be killed; everything but `live` runs in the parent."""

    def live(self, life: int, ready: Callable[[], None]) -> None:
        """In the child: attach, call `ready`, and go on until killed."""

    def serve(self) -> None:
        """One short turn of the parent's end, while the child lives."""

    def inspect(self, life: int, pid: int) -> None:
        """After the death of `pid`: Violation when something does not hold."""

    def finish(self) -> None:
        """A last successor puts all in order; Violation when that cannot be done. Closes everything."""


@dataclass(frozen=True, slots=True)
class Plan:
    """How a child dies: after `amount` steps or microseconds, counted from before (early) or after it has attached."""

    kind: str
    early: bool
    amount: int

    def __str__(self) -> str:
        return f"{self.kind} {self.amount} {'early' if self.early else 'late'}"

    def due(self, began: int, ready: int, now: int) -> bool:
        """Whether the parent has to kill it now; `ready` is 0 until it has attached."""
        if self.kind == TIME:
            begin = began if self.early else ready
            return begin > 0 and now - begin >= 1000 * self.amount
        return self.amount == UNTIL_KILLED and ready > 0


class Steps:
    """Counts bytecode steps inside shm/, and kills its own process at the last one."""

    def __init__(self, amount: int) -> None:
        self.amount = self.left = amount

    def start(self) -> None:
        """Count from here, in functions entered from now on."""
        sys.settrace(self._enter)

    def _enter(self, frame: FrameType, event: str, arg: object) -> Callable[..., Any] | None:
        if not frame.f_code.co_filename.startswith(TRACED):
            return None
        frame.f_trace_opcodes, frame.f_trace_lines = True, False
        return self._step

    def _step(self, frame: FrameType, event: str, arg: object) -> Callable[..., Any]:
        if event == "opcode":
            self.left -= 1
            if self.left == 0:
                os.kill(os.getpid(), signal.SIGKILL)
        return self._step


def child(victim: Victim, life: int, plan: Plan, notes: Notes) -> None:
    """The life of a child, up to its death; comes back never."""
    try:
        die_with_parent()
        steps = Steps(plan.amount)

        def ready() -> None:
            notes.words[Notes.ATTACH_STEPS] = steps.amount - steps.left
            notes.words[Notes.READY] = time.monotonic_ns()
            if plan.kind == STEPS and not plan.early:
                steps.start()

        if plan.kind == STEPS and plan.early:
            steps.start()
        victim.live(life, ready)
    except BaseException:
        sys.settrace(None)
        notes.text = traceback.format_exc()
    os._exit(3)


class Killer:
    """Lets one victim live and die again and again; reproducible from its seed, as far as the clock allows."""

    def __init__(self, victim: Victim, notes: Notes, seed: int, walk: int) -> None:
        self._victim, self._notes, self._random, self._walk = victim, notes, random.Random(seed), walk
        self._attach_steps = self._attach_us = 0
        self.counts: dict[str, int] = {}

    def kill(self, life: int) -> None:
        """One life and its death, inspected; a Violation says how it died."""
        plan = self._plan(life)
        self._notes.clear()
        began = time.monotonic_ns()
        pid = os.fork()
        if pid == 0:
            child(self._victim, life, plan, self._notes)
        try:
            status = self._attend(pid, plan, began)
            if not (os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGKILL):
                raise RingViolation(f"it ended by itself (status {status}): {self._notes.text}")
            self._victim.inspect(life, pid)
        except Exception as error:  # whatever it is, seed and death must be told
            reported = str(error) if isinstance(error, RingViolation) else traceback.format_exc()
            raise RingViolation(f"life {life}, {plan}: {reported}") from error
        name = f"{'early' if plan.early else 'late'} {plan.kind}"
        self.counts[name] = self.counts.get(name, 0) + 1

    def _plan(self, life: int) -> Plan:
        if self._walk:
            return Plan(STEPS, False, self._walk + STRIDE * (life - 1))
        kind, early = self._random.choice((STEPS, TIME)), self._random.randrange(4) == 0
        part = self._random.random()  # drawn before it is scaled: attaching never takes the same time twice
        if life <= 2:  # how long does attaching take, in steps and in time?
            return Plan(TIME if life == 1 else STEPS, life == 2, LATE_US if life == 1 else UNTIL_KILLED)
        if kind == STEPS:
            return Plan(kind, early, 1 + int(part * (self._attach_steps if early else LATE_STEPS)))
        return Plan(kind, early, int(part * (self._attach_us if early else LATE_US)))

    def _attend(self, pid: int, plan: Plan, began: int) -> int:
        """Serve the child until it is dead, kill it when its time has come; returns its status."""
        ready = 0
        while True:
            try:
                self._victim.serve()
            except BaseException:
                os.kill(pid, signal.SIGKILL)
                os.waitpid(pid, 0)
                raise
            gone, status = os.waitpid(pid, os.WNOHANG)
            if gone:
                return status
            now = time.monotonic_ns()
            if not ready and self._notes.words[Notes.READY]:
                ready = self._notes.words[Notes.READY]
                self._attach_us = self._attach_us or (ready - began) // 1000
                self._attach_steps = self._attach_steps or self._notes.words[Notes.ATTACH_STEPS]
            if plan.due(began, ready, now) or now - began > PATIENCE_NS:
                os.kill(pid, signal.SIGKILL)
                _, status = os.waitpid(pid, 0)
                holds(now - began <= PATIENCE_NS, "it did not come to its end")
                return status


VICTIMS: dict[str, Callable[[str, Notes], Victim]] = {
    "writer": lambda system, notes: victims.WriterVictim(system, notes, slots=64, size=216),
    "writer of 4 kB": lambda system, notes: victims.WriterVictim(system, notes, slots=3, size=4096),
    "reader": victims.ReaderVictim,
    "client": senders.ClientVictim,
    "who stops": senders.StopVictim,
    "owner": senders.OwnerVictim,
    "subscriber": victims.SubscriberVictim,
}


def descriptors() -> int:
    """How many files this process has open."""
    gc.collect()  # a place and its segment hold each other
    return len(list(Path("/proc/self/fd").iterdir()))


def run(system: str, name: str, kills: int, seed: int, wrong: str = "", walk: int = 0) -> dict[str, Any]:
    """Kill the victim `name` so many times; stops at the first violation, which names the seed."""
    if wrong:
        wrongs.WRONGS[wrong][0]()
    notes, begin = Notes(), time.monotonic_ns()
    victim = VICTIMS[name](system, notes)
    killer = Killer(victim, notes, seed, walk)
    gc.collect()
    gc.freeze()  # less for a fork to copy
    done, violation = 0, ""
    open_files = descriptors()
    try:
        for life in range(1, kills + 1):
            done = life
            killer.kill(life)
        holds(descriptors() <= open_files, f"{descriptors() - open_files} descriptors are left behind")
        victim.finish()
    except RingViolation as broken:
        violation = f"seed {seed}, {name}: {broken}"
    finally:
        remove_all(system)
    with contextlib.suppress(ChildProcessError):
        os.waitpid(-1, os.WNOHANG)
        violation = violation or f"seed {seed}, {name}: a process is left behind"
    return {"victim": name, "kills": done, "kinds": killer.counts, "violation": violation, "seed": seed,
            "seconds": round((time.monotonic_ns() - begin) / 1e9, 2), **getattr(victim, "figures", {})}


def main() -> None:
    """See the module's text."""
    system, name, kills, seed, wrong, walk = sys.argv[1:7]
    print(json.dumps(run(system, name, int(kills), int(seed), wrong, int(walk))), flush=True)
