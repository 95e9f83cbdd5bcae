"""A process's connection to its system: memory, clock, pacing, stalls and end, the same for every process."""

from __future__ import annotations

import contextlib
import logging
import os
import socket
from collections.abc import Callable
from typing import Final, Protocol, TypeVar

from trocar.procs.document.process import ELSEWHERE, ON_DEMAND
from trocar.procs.document.system import LOCKSTEP, WALL, Process, SystemConfig
from trocar.procs.machine.listening import handed
from trocar.procs.native.bound import BoundStruct
from trocar.procs.native.library import bind
from trocar.procs.native.pace_fields import PACE
from trocar.procs.node.inputs import Input
from trocar.procs.node.pacing import AFTER_OTHERS_NS, Pacing, Pauses, duration, phase_ns
from trocar.procs.node.realtime import fetch_segments, in_words, lock_memory, realtime, spin_ns, step_back
from trocar.procs.tables import codes
from trocar.procs.tables.manifest import LATE_S, late_s, lost_s, proc
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.audit import Audit
from trocar.shm.mailbox.client import LoopClient
from trocar.shm.mailbox.generations import Cell, FaultCell, Faults
from trocar.shm.mailbox.mailbox import DIED, Mailbox
from trocar.shm.memory.layout import shorten
from trocar.shm.ring.ring import RingReader, RingWriter
from trocar.shm.system import directory, loglines
from trocar.shm.system.events import Events
from trocar.shm.system.subscriptions import Subscriber, Subscriptions
from trocar.shm.time.clock import WallClock, monotonic_ns
from trocar.shm.time.control_page import ControlPage
from trocar.shm.time.lockstep import LockstepClock
from trocar.shm.time.system_time import SystemTime
from trocar.shm.time.wakeup import Wakeup

SUPERVISOR_CHECK_NS: Final = 100_000_000
OFTEN_S: Final = 0.005
"""Processes with a shorter period prepare for fast reads (see RingReader): 0.3 MB for each second at 1 kHz."""


class Closing(Protocol):
    """A resource that is released by `close`."""

    def close(self) -> None:
        """Release it."""


Part = TypeVar("Part", bound=Closing)


class NodeClock(Protocol):
    """The clock of one process: its time, and how to wait."""

    spin_ns: int
    wakeup: socket.socket | None

    @property
    def simulated(self) -> bool:
        """Whether it is not real time."""

    def now_ns(self) -> int:
        """The system's time."""

    def sleep_until(self, deadline_ns: int, stopped: Callable[[], bool]) -> object:
        """Sleep until the deadline, or until `stopped()` is true."""


class Node:
    """The instance of a process in a running system: its claim, control page, rings, events and mailbox, its access to
    other instances, its clock and its paced cycles.
    """

    def __init__(self, document: SystemConfig, name: str, clock: NodeClock | None = None, *,
                 period_s: float = 0.0) -> None:
        """Claim the instance; SegmentError when there is none or it is taken.

        `clock` and `period_s`: default, those of the document. Processes that the system file declares, and bridges
        like them, have periods in the system's time.
        """
        self.document, self.system, self.name = document, document.name, name
        self.row: Process = document.process(name)
        self.kind, self.late_s, self.log = self.row.kind, late_s(self.row), logging.getLogger(name)
        kind, declared = proc(self.kind), document.user(name)
        self._time = None if kind.in_time else SystemTime(self.system)
        clock = self._time if self._time is not None and kind.declared else clock
        self.simulated = clock.simulated if clock is not None else kind.in_time and document.clock != WALL
        """Whether its periods are simulated time."""
        self.is_child = self.row.start != ELSEWHERE or (declared is not None and declared.module != "")
        """Whether the supervisor has started it, and keeps its log; otherwise a person has."""
        self._held = contextlib.ExitStack()
        self._mailbox: Mailbox | None = None
        self._subscribers: dict[str, Subscriber] = {}  # at instances that run on demand
        with contextlib.ExitStack() as stack:
            self.page = stack.enter_context(contextlib.closing(ControlPage(self.system, name, write=True)))
            self.page.segment.claim(name)
            self.subscriptions = Subscriptions(self.page)
            self._supervisor = stack.enter_context(contextlib.closing(ControlPage(self.system, "supervisor")))
            events = stack.enter_context(contextlib.closing(directory.writer(self.system, name, "events", self.kind)))
            self._place = stack.pop_all()
        self.page.field("pid")[...] = os.getpid()
        self.page.field("pauses")[...] = 0
        logs = loglines.into(self.log) if self.is_child else None
        self.events = Events(events, self.stamp_ns, logs, name, self.row.typed)
        self.stall = ""
        """The stall after which the process restarted as if it had been killed, in words; "": its process was started.
        """
        self.held_up_ns = 0
        """Length of a stall before this cycle that was too long; otherwise 0."""
        self.page.show("STARTING")
        period_ns = round((period_s or self.row.period_s) * 1e9)
        ios_ns = [round(io.period_s * 1e9) for io in document.ios]
        self.pacing = Pacing(self.page, period_ns, phase_ns(kind.phase, period_ns, ios_ns))
        self.pauses = Pauses(0 if self.simulated else round(self.late_s * 1e9))
        self.listening = handed() if self.is_child else ()
        """The sockets of its `listen`, non-blocking; the supervisor keeps them open, also while we are down."""
        self.stop_reason, self._check_at, self._beat = "", 0, self.page.field("heartbeat_ns")
        self._wakeup = self.page.wakeup()
        self.clock: NodeClock
        if clock is not None:
            self.clock = clock
        else:
            self.clock = LockstepClock(self.system, name) if self.simulated else WallClock(spin_ns(document, name))
        bound = bind(PACE, self.pacing) if type(self.clock) is WallClock else ""
        self._waits = ((bound.function("wait"), bound.function("sleep"))
                       if isinstance(bound, BoundStruct) else None)
        """The native library's waits for the next deadline, and for news, on the wall clock; None: `tick` waits in
        Python.
        """
        self._granted: list[str] = []
        """The real-time properties that were granted, in words."""
        self.locks, self._locked = False, ""
        """Whether to lock the memory when ready; only if no other instance shares the process."""
        self.steps_back = False
        """Whether to lower its priority during setup, see `ask`; only if no other instance shares the process."""
        self.now_ns = self.clock.now_ns()

    def reads(self, instance: str, topic: str, *, counts: bool = True) -> RingReader:
        """Attach to a ring of another instance, or of the supervisor.

        While held, the reader of an instance that runs on demand is also a subscriber, unless `counts` is False.
        """
        if instance == "supervisor":
            return self.hold(directory.reader(self.system, instance, topic, instance))
        if counts and instance != self.name and self.document.process(instance).start == ON_DEMAND:
            if instance not in self._subscribers:
                self._subscribers[instance] = self.hold(Subscriber(self.system, instance, self.name))
            self._subscribers[instance].want(topic)
        often = self.row.period_s < OFTEN_S
        return self.hold(directory.reader(self.system, instance, topic, self._layout(instance, topic), often=often))

    def _layout(self, instance: str, topic: str) -> str | None:
        """The kind whose row defines the layout of a topic; None: the system file defines it."""
        kind = self.document.process(instance).kind
        is_declared = self.document.user(instance) is not None and topic not in (*proc(kind).topics, "events", "audit")
        return None if is_declared else kind

    def input(self, instance: str, topic: str = "state", late_s: float = LATE_S) -> Input:
        """The newest record of another instance; records older than `late_s` are not fresh."""
        return Input(self.reads(instance, topic), late_s)

    def writes(self, topic: str) -> RingWriter:
        """Claim one of our own rings."""
        return self.hold(directory.writer(self.system, self.name, topic, self._layout(self.name, topic)))

    def mailbox(self, guard: Cell | None = None) -> Mailbox:
        """Our own mailbox; commands that wait in it when the loop begins are refused.

        `guard`: commands for power or motion need an operator's command given after the last fault of this cell.
        """
        audit = Audit(self.writes("audit"), self.stamp_ns, every=self.document.clock == LOCKSTEP)
        self._mailbox = self.hold(Mailbox(self.system, self.name, COMMANDS.get(self.kind, ()), guard=guard, audit=audit,
                                          died=self.stall or DIED))
        return self._mailbox

    def faults(self) -> Faults:
        """The fault page of the system."""
        return self.hold(Faults(self.system))

    def fault_cell(self, component: str = "") -> FaultCell:
        """The fault cell of one of our components; default: this instance."""
        return FaultCell(self.hold(Faults(self.system, write=True)), component or self.name)

    def waker_for(self, instance: str) -> Wakeup:
        """The wake-up of an instance that waits for news; call its `wake` after publishing."""
        return self.hold(ControlPage(self.system, instance, write=True)).wakeup()

    def hold(self, part: Part) -> Part:
        """Keep a resource until `give_back` closes all that are held."""
        self._held.callback(part.close)
        return part

    def give_back(self) -> None:
        """Close all held resources, but keep the claim."""
        self._mailbox = None
        self._subscribers.clear()
        self._held.close()

    def stamp_ns(self) -> int:
        """The system's time for stamps of records, also in a process that itself runs in real time."""
        return self.clock.now_ns() if self._time is None else self._time.now_ns()

    def commands(self, instance: str) -> LoopClient:
        """A handle for the mailbox of another instance; all our handles share one place there.

        Commands of a cycle that was paused are dropped.
        """
        called = self.name if self.name == self.kind else f"{self.kind} {self.name}"
        return self.hold(LoopClient(self.system, instance, called, self.pauses.is_over))

    def begin(self, error: str = "") -> None:
        """Show it as running, with an error if any; refuse waiting commands, which were sent to its predecessor."""
        if self._mailbox is not None:
            self._mailbox.refuse_waiting(self.stall or f"{self.name} has just started; try again")
        self.page.show("RUNNING", error)

    def stop(self, reason: str) -> None:
        """Request its end at the next call of `stopped`; the first reason is kept."""
        self.stop_reason = self.stop_reason or reason

    def beat(self) -> None:
        """Update the heartbeat."""
        self._beat[...] = monotonic_ns()

    def stopped(self) -> bool:
        """Update the heartbeat; True if the process must end: on request, or as the supervisor's heartbeat is lost.

        In simulated time nothing is at risk, so a living supervisor may be short of CPU time for longer.
        """
        self._beat[...] = now = monotonic_ns()
        if now >= self._check_at:
            self._check_at = now + SUPERVISOR_CHECK_NS
            silent_s = self.silent_s
            is_patient = self.simulated and not (self.is_child and os.getppid() != self._supervisor.get("pid"))
            if silent_s > lost_s(self.document, simulated=is_patient):
                self.stop(f"no heartbeat of the supervisor for {silent_s:.1f} s")
        return bool(self.stop_reason)

    @property
    def silent_s(self) -> float:
        """Time since the supervisor's last heartbeat, s."""
        return (monotonic_ns() - int(self._supervisor.get("heartbeat_ns"))) * 1e-9

    @property
    def supervisor_state(self) -> str:
        """The supervisor's state on its control page."""
        return self._supervisor.state

    def ready(self, error: str = "") -> None:
        """Report that setup has succeeded, with an error if any, and start pacing; processes that wait continue."""
        self._lock()
        if self.steps_back:
            self.ask()
        self.begin(error)
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
        self._granted = realtime(self.row, self.document.clock, reserved=proc(self.kind).reserved)
        self._show_granted()

    def _show_granted(self) -> None:
        self.page.field("policy")[...] = in_words([*self._granted, *filter(None, (self._locked,))])

    def begin_anew(self) -> None:
        """Report that it was stalled so long that it restarts, as if it had been killed and started again."""
        if self.steps_back:
            step_back()
        held_up_ns, self.held_up_ns = self.held_up_ns, 0
        self.stall = f"{self.name} stalled for {duration(held_up_ns)}"
        self.page.show("STARTING")
        self.page.field("pauses")[...] += 1
        self.events.report(codes.HELD_UP, self.stall, self.name, value=held_up_ns * 1e-9, limit=self.late_s)
        self.pauses.end()

    def follows(self, name: str) -> None:
        """Name the process whose cycles ours will follow (see `follow`); its period is in the document."""
        self.pacing.follows(round(self.document.process(name).period_s * 1e9))

    def follow(self, stamp_ns: int, lead_ns: int) -> None:
        """Keep our cycle `lead_ns` behind a stamp of the process that we follow."""
        if not self.simulated:
            self.pacing.follow(stamp_ns + lead_ns)

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
        if self._waits is not None and serve is None:
            wait, sleep = self._waits
            if news is None:
                now_ns = wait(periods, self.clock.spin_ns)
            else:
                self._wakeup.begin()
                if news():
                    self._wakeup.end()
                now_ns = sleep(periods)
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
            while not self.stopped() and (left := deadline - self.clock.now_ns()) > 0:
                serve(left)
        self.now_ns = self.clock.now_ns()
        pacing.begin_work(self.now_ns)
        self.held_up_ns = self.pauses.next(periods * pacing.period_ns)
        return not self.stopped()

    def _wait_for_news(self, deadline: int, news: Callable[[], bool]) -> None:
        clock, found, soonest = self.clock, False, self.now_ns + self.pacing.quickest_ns
        if isinstance(clock, LockstepClock):
            clock.sleep_until(deadline, self.stopped, news)
            soonest = max(soonest, clock.now_ns()) + AFTER_OTHERS_NS
        else:
            while not found and (left := deadline - clock.now_ns()) > 0 and not self.stop_reason:
                found = self._wakeup.sleep(news, left)
        clock.sleep_until(min(deadline, soonest), self.stopped)
        if (now := clock.now_ns()) < deadline:
            self.pacing.early(now)

    def close(self) -> None:
        """Release everything at the end of the process."""
        if isinstance(self.clock, LockstepClock):
            self.clock.close()
        if self._time is not None:
            self._time.close()
        self.give_back()
        self._place.close()
