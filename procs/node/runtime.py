"""The life of a process of ours, whose loop file holds none of these words: priority, clock, pacing, a pause, its end.

    class Loop(runtime.Loop):
        def __init__(self, node): ...
        def cycle(self, now_ns, wall_ns): ...
    def main():
        runtime.run("arm", Loop)
"""

from __future__ import annotations

import contextlib
import faulthandler
import gc
import logging
import os
import signal
import socket
import sys
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from typing import Protocol

from trocar.procs.document.system import WALL, SystemConfig
from trocar.procs.native.bound import BoundStruct
from trocar.procs.native.library import bind
from trocar.procs.native.pace_fields import PACE
from trocar.procs.node.life import SETUP_FAILED, arguments, document_of, lived
from trocar.procs.node.node_memory import NodeMemory
from trocar.procs.node.pacing import QUICKEST_NS
from trocar.procs.node.realtime import fetch_segments, in_words, lock_memory, realtime, step_back
from trocar.procs.tables.manifest import proc
from trocar.shm.mailbox.client import LoopClient
from trocar.shm.memory.layout import shorten
from trocar.shm.memory.segment import SegmentError
from trocar.shm.time.clock import WallClock
from trocar.shm.time.lockstep import LockstepClock
from trocar.shm.time.system_time import SystemTime

MAX_SPIN_US = 50.0


class NodeClock(Protocol):
    """What time it is for one process, and how it waits."""

    simulated: bool
    spin_ns: int
    wakeup: socket.socket | None

    def now_ns(self) -> int:
        """The system's time."""

    def sleep_until(self, deadline_ns: int, stopped: Callable[[], bool]) -> object:
        """Sleep until the deadline, or `stopped()`."""


class Node(NodeMemory):
    """What a process of ours knows of itself; made by `process`. It has a clock, and its loop is paced."""

    def __init__(self, document: SystemConfig, name: str, clock: NodeClock | None = None) -> None:
        """Attach to the running system; SegmentError when there is none. `clock`: not as its document says."""
        system, in_time = document.name, proc(document.process(name).kind).in_time
        simulated = clock.simulated if clock is not None else in_time and document.clock != WALL
        self.clock: NodeClock
        self._time = None if in_time else SystemTime(system)
        super().__init__(document, name, self.stamp_ns, simulated=simulated)
        if clock is not None:
            self.clock = clock
        else:
            self.clock = LockstepClock(system, name) if simulated else WallClock(_spin_ns(document, name))
        self._wakeup = self.page.wakeup()
        bound = bind(PACE, self.pacing) if type(self.clock) is WallClock else ""
        self._wait = bound.function("wait") if isinstance(bound, BoundStruct) else None
        """The native library's wait for the next deadline, on the wall clock; None: `tick` waits step by step."""
        self.granted: list[str] = []
        """What the scheduler gave us, in words."""
        self.locks, self._locked = False, ""
        """Its memory is to be locked when it is ready: the process is its alone."""
        self.steps_back = False
        """It steps back while it is made, see `ask`: the process is its alone."""
        self.held_up_ns = 0
        """How long it was held up, when that was too long: the loop is to be made anew."""
        self.now_ns = self.clock.now_ns()

    def stamp_ns(self) -> int:
        """What time the system has, as records are stamped: also of a process that goes by real time itself."""
        return self.clock.now_ns() if self._time is None else self._time.now_ns()

    def commands(self, instance: str) -> LoopClient:
        """A handle for the mailbox of another instance; all of ours share one place there.

        What a cycle sends after a pause in its middle is not sent.
        """
        called = self.name if self.name == self.kind else f"{self.kind} {self.name}"
        return self.hold(LoopClient(self.system, instance, called, self.pauses.is_over))

    def is_over(self) -> bool:
        """We were held up in the middle of this cycle: what it does is about the past."""
        return self.pauses.is_over()

    def over_ns(self) -> int:
        """From when on that is so in this cycle, on CLOCK_BOOTTIME."""
        return self.pauses.over_ns

    def ready(self) -> None:
        """Setup has succeeded; whoever waits at the barrier goes on."""
        self._lock()
        if self.steps_back:
            self.ask()
        self.begin()
        if isinstance(self.clock, LockstepClock):
            self.clock.join(self.stopped)
        self.now_ns = self.clock.now_ns()
        self.pacing.begin(self.now_ns, self.simulated)
        self.pauses.begin()

    def _lock(self) -> None:
        """Lock our memory now that everything is in it; after a pause, only what is new."""
        if self._locked:
            fetch_segments()
        elif self.locks:
            self._locked = lock_memory()
            self._show_granted()

    def ask(self) -> None:
        """Ask the scheduler for what our row says, and show what was obtained.

        A loop is made with the lowest priority: that takes 20 ms of a core, and some of those one after the other would
        hold up who runs there with ours, so that they are made anew as well, and hold up us, for ever. Who reserves a
        share comes before them anyway, and keeps it.
        """
        self.granted = realtime(self.row, self.document.clock, reserved=proc(self.kind).reserved)
        self._show_granted()

    def _show_granted(self) -> None:
        self.page.field("policy")[...] = in_words([*self.granted, *filter(None, (self._locked,))])

    def begin_anew(self) -> None:
        """After a pause, before the loop is made anew: as if the process had been killed and started again."""
        if self.steps_back:
            step_back()
        self.report_pause(self.held_up_ns)
        self.held_up_ns = 0
        self.pauses.end()
        gc.collect()  # what is left of the old loop; all that is older is frozen

    def follows(self, name: str) -> None:
        """The process `name` is whom we `follow`."""
        self.pacing.follows(round(self.document.process(name).period_s * 1e9))

    def follow(self, stamp_ns: int, lead_ns: int) -> None:
        """Keep our cycle `lead_ns` behind the stamps of the process whose data we use."""
        if not self.simulated:
            self.pacing.follow(stamp_ns + lead_ns)

    def latency(self, latency_ns: int) -> None:
        """How long this cycle took from what it reacts to to its reaction; shown as statistics."""
        self.pacing.latency(latency_ns)

    def computes(self, why_numpy: str) -> None:
        """Show what does the work of many axes: the native library, or numpy, and why."""
        shown = f"numpy: {why_numpy}" if why_numpy else "native"
        self.page.field("computes")[...] = shorten(shown, self.page.field("computes").itemsize - 1)

    @property
    def is_overloaded(self) -> bool:
        """The machine has not enough time for everybody: who can do with less should."""
        return self.now_ns < self.pacing.short_until_ns

    @property
    def wall_ns(self) -> int:
        """`now_ns` where it is real time, for `Mailbox.drain`; 0 in lock-step, where nothing comes late."""
        return 0 if self.simulated else self.now_ns

    def tick(self, serve: Callable[[int], bool] | None = None, news: Callable[[], bool] | None = None,
             periods: int = 1) -> bool:
        """End this cycle, wait for the next one; False when the process must end.

        `serve(timeout_ns)` is called while waiting, for processes that also answer sockets: see
        `LockstepClock.serve_until`. `news()` true begins the
        next cycle early; it is asked when somebody wakes us (`waker_for`; a command does, see shm/commands.py). Who has
        nothing to do sleeps through so many `periods` instead of one.
        """
        pacing = self.pacing
        if self._wait is not None and serve is None and news is None:
            now_ns = self._wait(periods, self.clock.spin_ns)
            if now_ns < 0:
                now_ns = -now_ns
                pacing.look(now_ns)
            self.now_ns = now_ns
            self.held_up_ns = self.pauses.next(periods * pacing.period_ns)
            return not (self.stop_reason or (now_ns >= self._check_at and self.stopped()))
        deadline = pacing.end_of_work(self.clock.now_ns(), periods)
        if news is not None:
            self._wait_for_news(deadline, news)
        elif serve is None:
            self.clock.sleep_until(deadline, self.stopped)
        elif isinstance(self.clock, LockstepClock):
            self.clock.serve_until(deadline, self.stopped, serve)
        else:
            while (left := deadline - self.clock.now_ns()) > 0 and not self.stop_reason:
                serve(left)
        self.now_ns = self.clock.now_ns()
        pacing.begin_work(self.now_ns)
        self.held_up_ns = self.pauses.next(periods * pacing.period_ns)
        return not self.stopped()

    def _wait_for_news(self, deadline: int, news: Callable[[], bool]) -> None:
        clock, found = self.clock, False
        if isinstance(clock, LockstepClock):
            clock.sleep_until(deadline, self.stopped, news)
        else:
            while not found and (left := deadline - clock.now_ns()) > 0 and not self.stop_reason:
                found = self._wakeup.sleep(news, left)
        clock.sleep_until(min(deadline, self.now_ns + QUICKEST_NS), self.stopped)
        if (now := clock.now_ns()) < deadline:
            self.pacing.early(now)

    def close(self) -> None:
        """The end of this process."""
        gc.unfreeze()  # or extension modules see their objects leak at exit
        gc.enable()
        if isinstance(self.clock, LockstepClock):
            self.clock.close()
        if self._time is not None:
            self._time.close()
        self.leave()


class Loop(ABC):
    """What a process does: made when it begins, then `wait` and `cycle` by turns, closed at the end on every path."""

    def __init__(self, node: Node) -> None:
        """Take rings and mailboxes by `node`, which gives them back after `close`."""
        self.node = node

    def wait(self) -> bool:
        """End this cycle, wait for the next one; False when the process must end."""
        return self.node.tick()

    @abstractmethod
    def cycle(self, now_ns: int, wall_ns: int) -> None:
        """Receive, decide, act, publish; `wall_ns` is `Node.wall_ns`."""

    def close(self) -> None:  # noqa: B027  # most have nothing
        """Leave things in order, and give back what was not taken by `node`."""


def run(kind: str, make: Callable[[Node], Loop]) -> None:
    """The life of one process."""
    with process(kind) as node:
        if proc(kind).realtime:
            gc.collect()
            gc.freeze()
            gc.disable()
        live(node, make)


def live(node: Node, make: Callable[[Node], Loop]) -> None:
    """Run a loop to the end of the process; after each pause a new one, as if the process had been started again."""
    _run_one(node, make)
    while not node.stop_reason:
        node.begin_anew()
        _run_one(node, make)


def _run_one(node: Node, make: Callable[[Node], Loop]) -> None:
    with contextlib.ExitStack() as held:
        held.callback(node.give_back)
        loop = make(node)
        held.callback(loop.close)
        node.ready()
        while loop.wait() and not node.held_up_ns:
            loop.cycle(node.now_ns, node.wall_ns)


@contextlib.contextmanager
def process(kind: str) -> Iterator[Node]:
    """The life of one process of ours, with the priority of its row."""
    chosen = arguments(kind)
    faulthandler.register(signal.SIGUSR1, file=2, all_threads=False)  # its log shows where it hangs, see supervisor
    try:
        node = Node(document_of(chosen.system), chosen.name)
    except (SegmentError, KeyError, ValueError) as error:
        logging.getLogger(chosen.name).error("%s", error)
        sys.exit(SETUP_FAILED)
    row = proc(kind)
    with lived(node):
        node.ask()
        node.steps_back = node.row.priority > 0 and not row.reserved
        if node.steps_back:
            step_back()
        node.locks = row.realtime and not node.simulated
        yield node
    node.close()


def _spin_ns(system: SystemConfig, name: str) -> int:
    """An io may spin, for as long as its bus's entry says, and never on its only core; without boards nobody gains."""
    spin_us = next((io.spin_us for io in system.ios if io.name == name and io.port), 0.0)
    given = system.process(name).cpus  # not ours yet: we begin where the supervisor may run
    return round(min(spin_us, MAX_SPIN_US) * 1e3) if given or len(os.sched_getaffinity(0)) > 1 else 0
