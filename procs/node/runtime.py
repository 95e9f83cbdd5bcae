"""Runtime of our processes; their loop files need no code for priority, clock, pacing, pauses and exit.

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
    """The clock of one process: its time, and how to wait."""

    simulated: bool
    spin_ns: int
    wakeup: socket.socket | None

    def now_ns(self) -> int:
        """The system's time."""

    def sleep_until(self, deadline_ns: int, stopped: Callable[[], bool]) -> object:
        """Sleep until the deadline, or until `stopped()` is true."""


class Node(NodeMemory):
    """A process of ours, made by `process`: an instance in shared memory with a clock and a paced loop."""

    def __init__(self, document: SystemConfig, name: str, clock: NodeClock | None = None) -> None:
        """Attach to the running system; SegmentError when there is none. `clock` replaces that of the document."""
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
        """The native library's wait for the next deadline, on the wall clock; None: `tick` waits in Python."""
        self.granted: list[str] = []
        """The real-time properties that were granted, in words."""
        self.locks, self._locked = False, ""
        """Whether to lock the memory when ready; only if no other instance shares the process."""
        self.steps_back = False
        """Whether to lower its priority during setup, see `ask`; only if no other instance shares the process."""
        self.held_up_ns = 0
        """Length of a pause that was too long: the loop has to be made again; otherwise 0."""
        self.now_ns = self.clock.now_ns()

    def stamp_ns(self) -> int:
        """The system's time for stamps of records, also in a process that itself runs in real time."""
        return self.clock.now_ns() if self._time is None else self._time.now_ns()

    def commands(self, instance: str) -> LoopClient:
        """A handle for the mailbox of another instance; all our handles share one place there.

        Commands of a cycle that was paused are dropped.
        """
        called = self.name if self.name == self.kind else f"{self.kind} {self.name}"
        return self.hold(LoopClient(self.system, instance, called, self.pauses.is_over))

    def is_over(self) -> bool:
        """Whether this cycle was stalled so long that its results are outdated."""
        return self.pauses.is_over()

    def over_ns(self) -> int:
        """The time on CLOCK_BOOTTIME at which `is_over` becomes true in this cycle."""
        return self.pauses.over_ns

    def ready(self) -> None:
        """Report that setup has succeeded, and start pacing; processes that wait for this one continue."""
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
        """Lock our memory after setup; after a pause, only fetch new segments."""
        if self._locked:
            fetch_segments()
        elif self.locks:
            self._locked = lock_memory()
            self._show_granted()

    def ask(self) -> None:
        """Request the real-time properties of our row, and show the result.

        A loop is made with the lowest priority: that takes 20 ms of a core, and several in a row would stall the other
        loops on that core, which would then restart and stall ours, endlessly. A process with a reserved share runs
        before them anyway, and keeps the share.
        """
        self.granted = realtime(self.row, self.document.clock, reserved=proc(self.kind).reserved)
        self._show_granted()

    def _show_granted(self) -> None:
        self.page.field("policy")[...] = in_words([*self.granted, *filter(None, (self._locked,))])

    def begin_anew(self) -> None:
        """Restart after a pause, before the loop is made again: as if the process had been killed and started."""
        if self.steps_back:
            step_back()
        self.report_pause(self.held_up_ns)
        self.held_up_ns = 0
        self.pauses.end()
        gc.collect()  # collects the old loop; older objects are frozen

    def follows(self, name: str) -> None:
        """Name the process whose cycles ours will follow (see `follow`); its period is in the document."""
        self.pacing.follows(round(self.document.process(name).period_s * 1e9))

    def follow(self, stamp_ns: int, lead_ns: int) -> None:
        """Keep our cycle `lead_ns` behind a stamp of the process that we follow."""
        if not self.simulated:
            self.pacing.follow(stamp_ns + lead_ns)

    def latency(self, latency_ns: int) -> None:
        """Record this cycle's time from input to reaction, for the statistics."""
        self.pacing.latency(latency_ns)

    def computes(self, why_numpy: str) -> None:
        """Show what computes the axes: the native library, or numpy with the reason."""
        shown = f"numpy: {why_numpy}" if why_numpy else "native"
        self.page.field("computes")[...] = shorten(shown, self.page.field("computes").itemsize - 1)

    @property
    def is_overloaded(self) -> bool:
        """Whether the machine is overloaded, so that loops should skip work that they can do without."""
        return self.now_ns < self.pacing.short_until_ns

    @property
    def wall_ns(self) -> int:
        """`now_ns` if it is real time, for `Mailbox.drain`; 0 in lock-step, where no command is late."""
        return 0 if self.simulated else self.now_ns

    def tick(self, serve: Callable[[int], bool] | None = None, news: Callable[[], bool] | None = None,
             periods: int = 1) -> bool:
        """End this cycle and wait for the next one; False when the process must end.

        `serve(timeout_ns)` is called while waiting, for processes that also answer sockets: see
        `LockstepClock.serve_until`. `news()` true begins the next cycle early; it is called after each wake-up
        (`waker_for`, or a command, see shm/commands.py). An idle process passes the number of `periods` to sleep.
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
        """Release everything at the end of the process."""
        gc.unfreeze()  # otherwise extension modules report leaks at exit
        gc.enable()
        if isinstance(self.clock, LockstepClock):
            self.clock.close()
        if self._time is not None:
            self._time.close()
        self.leave()


class Loop(ABC):
    """The work of a process: made at its begin, then `wait` and `cycle` alternate; always closed at the end."""

    def __init__(self, node: Node) -> None:
        """Open rings and mailboxes through `node`, which closes them after `close`."""
        self.node = node

    def wait(self) -> bool:
        """End this cycle and wait for the next one; False when the process must end."""
        return self.node.tick()

    @abstractmethod
    def cycle(self, now_ns: int, wall_ns: int) -> None:
        """Receive, decide, act, publish; `wall_ns` is `Node.wall_ns`."""

    def close(self) -> None:  # noqa: B027  # most have nothing
        """Clean up, and release resources that `node` does not hold."""


def run(kind: str, make: Callable[[Node], Loop]) -> None:
    """Run one process of this kind, from start to exit."""
    with process(kind) as node:
        if proc(kind).realtime:
            gc.collect()
            gc.freeze()
            gc.disable()
        live(node, make)


def live(node: Node, make: Callable[[Node], Loop]) -> None:
    """Run loops until the process ends: after each pause a new one, as if the process had been started again."""
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
    """Start one process of ours with the priority of its row; closes it at the end."""
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
    """Spin time of an io, as configured for its bus; 0 on the only core, and without boards, where it has no use."""
    spin_us = next((io.spin_us for io in system.ios if io.name == name and io.port), 0.0)
    given = system.process(name).cpus  # not ours yet: we begin where the supervisor may run
    return round(min(spin_us, MAX_SPIN_US) * 1e3) if given or len(os.sched_getaffinity(0)) > 1 else 0
