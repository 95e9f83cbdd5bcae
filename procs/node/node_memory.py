"""An instance's shared memory: its claim, control page, rings, events and mailbox, and its access to other instances.

Also the duties of every process there, ours or a user's: heartbeat, pacing, and a look at whether it must end.
"""

from __future__ import annotations

import contextlib
import logging
import os
from collections.abc import Callable
from typing import Final, Protocol, TypeVar

from trocar.procs.document.process import ON_DEMAND
from trocar.procs.document.system import LOCKSTEP, Process, SystemConfig
from trocar.procs.machine.listening import handed
from trocar.procs.node.inputs import Input
from trocar.procs.node.pacing import Pacing, Pauses, duration, phase_ns
from trocar.procs.tables import codes
from trocar.procs.tables.manifest import LATE_S, SIMULATED_LOST, late_s, proc
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.audit import Audit
from trocar.shm.mailbox.generations import Cell, FaultCell, Faults
from trocar.shm.mailbox.mailbox import DIED, Mailbox
from trocar.shm.ring.ring import RingReader, RingWriter
from trocar.shm.system import directory, loglines
from trocar.shm.system.events import Events
from trocar.shm.system.subscriptions import Subscriber, Subscriptions
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import ControlPage
from trocar.shm.time.wakeup import Wakeup

SUPERVISOR_CHECK_NS: Final = 100_000_000


class Closing(Protocol):
    """A resource that is released by `close`."""

    def close(self) -> None:
        """Release it."""


Part = TypeVar("Part", bound=Closing)


class NodeMemory:
    """One instance in a running system, from its claim to `leave`."""

    def __init__(self, document: SystemConfig, name: str, now_ns: Callable[[], int], *, simulated: bool = False,
                 period_s: float = 0.0, is_child: bool = True) -> None:
        """Claim the instance; SegmentError when there is none or it is taken. `now_ns` gives the system's time.

        `simulated`: its periods are simulated time. `period_s`: default, that of its row. `is_child`: the supervisor
        has started the process and keeps its log; otherwise a person has.
        """
        self.document, self.system, self.name = document, document.name, name
        self.row: Process = document.process(name)
        self.log, self.simulated, self._is_child = logging.getLogger(name), simulated, is_child
        self.kind, self.late_s = self.row.kind, late_s(self.row)
        self._held, self._lost_ns = contextlib.ExitStack(), round(document.supervisor_lost_s * 1e9)
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
        self._time_ns = now_ns
        self.events = Events(events, now_ns, loglines.into(self.log) if is_child else None, name, self.row.typed)
        self.stall = ""
        """The stall after which the process restarted as if it had been killed, in words; "": its process was started.
        """
        self.page.show("STARTING")
        kind, period_ns = proc(self.kind), round((period_s or self.row.period_s) * 1e9)
        ios_ns = [round(io.period_s * 1e9) for io in document.ios]
        self.pacing = Pacing(self.page, period_ns, phase_ns(kind.phase, period_ns, ios_ns))
        self.pauses = Pauses(round(self.late_s * 1e9) if kind.pause_ends and not simulated else 0)
        self.listening = handed() if is_child else ()
        """The sockets of its `listen`, non-blocking; the supervisor keeps them open, also while we are down."""
        self.stop_reason, self._check_at, self._beat = "", 0, self.page.field("heartbeat_ns")

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
        return self.hold(directory.reader(self.system, instance, topic, self._layout(instance, topic)))

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
        audit = Audit(self.writes("audit"), self._time_ns, every=self.document.clock == LOCKSTEP)
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

    def begin(self, error: str = "") -> None:
        """Show it as running, with an error if any; refuse waiting commands, which were sent to its predecessor."""
        if self._mailbox is not None:
            self._mailbox.refuse_waiting(self.stall or f"{self.name} has just started; try again")
        self.page.show("RUNNING", error)

    def report_pause(self, held_up_ns: int) -> None:
        """Report that it was stalled so long that it restarts, as if it had been killed and started again."""
        self.stall = f"{self.name} stalled for {duration(held_up_ns)}"
        self.page.show("STARTING")
        self.page.field("pauses")[...] += 1
        self.events.report(codes.HELD_UP, self.stall, self.name, value=held_up_ns * 1e-9, limit=self.late_s)

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
            silent_s = self.lost_s()
            is_patient = self.simulated and not (self._is_child and os.getppid() != self._supervisor.get("pid"))
            if silent_s and (not is_patient or silent_s * 1e9 > SIMULATED_LOST * self._lost_ns):
                self.stop(f"no heartbeat of the supervisor for {silent_s:.1f} s")
        return bool(self.stop_reason)

    def lost_s(self) -> float:
        """The silence of the supervisor, s, if that is too long; otherwise 0."""
        silent_ns = monotonic_ns() - int(self._supervisor.get("heartbeat_ns"))
        return silent_ns * 1e-9 if silent_ns > self._lost_ns else 0.0

    @property
    def supervisor_state(self) -> str:
        """The supervisor's state on its control page."""
        return self._supervisor.state

    def leave(self) -> None:
        """Close all resources and release the claim."""
        self.give_back()
        self._place.close()
