"""A whole system in this process: its loops one after the other, as their time comes, on a clock that is stepped.

    with Host(document) as host:
        psm = host.client("PSM1")
        psm.send("state_command", (), "enable")
        host.run(0.5)

What happens is what happens in lock-step between processes. Its shared memory has no names (shm/memory/private.py):
nothing is left of it, whatever becomes of the process. There is no supervisor: a loop that raises an error ends the
host.
"""

from __future__ import annotations

import contextlib
import os
import weakref
from collections.abc import Callable, Iterator
from typing import Any, Self

from trocar.procs.crtk.names import none_such
from trocar.procs.document.system import SystemConfig
from trocar.procs.host.loops import HostedBoards, HostError, made
from trocar.procs.host.node import HostedNode, SteppedClock
from trocar.procs.host.objects import UnknownTypeError
from trocar.procs.host.snapshot import HostMemory, HostSnapshot
from trocar.procs.node.runtime import Loop
from trocar.procs.supervisor import memory
from trocar.procs.supervisor.memory import simulated
from trocar.procs.tables.manifest import proc
from trocar.shm.mailbox.client import Client
from trocar.shm.memory import private
from trocar.shm.memory.layout import Schema
from trocar.shm.memory.segment import Make, create, names_of
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, sleeping_by
from trocar.shm.time.control_page import ControlPage
from trocar.shm.time.lockstep import SCHEMA, clock_page, create_clock

HISTORY = 8
"""Records that rings keep, unless somebody wants more."""
TOLD = 128
"""Of events and audits, of which each counts, at least so many: what is told in a second or two."""


COARSEST_S = 0.002
"""Of the physics of a PSM on boards: with longer steps the light joints of its wrist ring, and io trips."""


FIRST_NUMBER = 1 << 31
"""Beyond those that this process gives elsewhere."""


class CommandNumbers:
    """Numbers of the persons' commands in a host, the same ones each time (shm/mailbox/origins.py)."""

    def __init__(self) -> None:
        self._count = 0

    def next(self) -> int:
        """One that no other command in this host has."""
        self._count += 1
        return os.getpid() << 32 | FIRST_NUMBER + self._count


class Host:
    """One system. Time begins at EPOCH_NS (shm/time/lockstep.py) and passes in `run` only."""

    def __init__(self, document: SystemConfig, history: int = HISTORY) -> None:
        """HostError for what cannot run here: real boards, users' processes, PSMs on boards with coarse physics.

        `history`: records that rings keep; of events and audits TOLD at least.
        """
        self.document, self.name = document, document.name
        self.clock = SteppedClock()
        self.loops: dict[str, Loop] = {}
        self._handles: list[Client | RingReader] = []
        self._numbers = CommandNumbers()
        self._memory: HostMemory | None = None
        self._places: list[Client] = []  # one at each mailbox: it has the place that all handles there share
        self._turns: dict[str, tuple[HostedNode, Callable[[], bool], Callable[[int, int], None]]] = {}
        self._held = contextlib.ExitStack()
        weakref.finalize(self, _give_back, self._held, os.getpid()).atexit = False
        wanted = [row for row in document.processes if proc(row.kind).in_time]
        if users := [row.name for row in document.users]:
            raise HostError(f"{', '.join(users)}: processes of users do not run in a host")
        _refuse_coarse(document)
        if private.is_kept(self.name):
            raise HostError(f"this process has a host {self.name} already; close that, or give this one another name")
        private.keep(self.name)
        try:
            self._held.callback(private.forget, self.name)
            memory.create_all(document, _short(history))
            self._pages = HostPages(document, self.clock)
            self._held.callback(self._pages.close)
            for row in wanted:
                self._add(HostedNode(document, row.name, self.clock))
        except BaseException:
            self._held.close()
            raise

    def _add(self, node: HostedNode) -> None:
        self._held.callback(node.leave)
        self._begin(node)
        loops, name = self.loops, node.name
        self._held.callback(lambda: loops[name].close())

    def _begin(self, node: HostedNode) -> None:
        boards = self.loops.get("boards")
        loop = made(node, boards if isinstance(boards, HostedBoards) else None)
        node.ready()
        loop.wait()
        self.loops[node.name] = loop
        self._turns[node.name] = node, loop.wait, loop.cycle

    def restart(self, instance: str, *, killed: bool = False) -> None:
        """The loop of an instance anew, as a process that was started again begins; `killed`: it left nothing in order.

        Earlier snapshots do not count any more. HostError: there is none, or it is the boards, which stay as they are.
        """
        node = self._node(instance)
        if instance == "boards":
            raise HostError("boards do not restart in a host")
        if not killed:
            self.loops[instance].close()
        node.give_back()
        self._memory, self._places = None, []
        self._begin(node)

    def delay(self, instance: str, seconds: float) -> None:
        """The next cycle of an instance is so much later, as if its process had no core. HostError: there is none."""
        node = self._node(instance)
        node.due_ns, node.news = max(node.due_ns, self.clock.time_ns) + round(seconds * 1e9), None

    def _node(self, instance: str) -> HostedNode:
        if instance not in self._turns:
            raise HostError(none_such("process", instance, self._turns, self.name))
        return self._turns[instance][0]

    @property
    def now_ns(self) -> int:
        """The system's time."""
        return self.clock.time_ns

    def run(self, seconds: float) -> None:
        """Let so much time pass."""
        self.run_until(self.clock.time_ns + round(seconds * 1e9))

    def run_until(self, end_ns: int) -> None:
        """Let time pass up to this moment; what is due then is done. HostError: it has passed, or all is closed."""
        clock, turns = self.clock, list(self._turns.values())
        if end_ns < clock.time_ns or not private.is_kept(self.name):
            raise HostError(f"{self.name} is closed" if not private.is_kept(self.name) else
                            f"the time of {self.name} is {clock.time_ns} ns, it does not go back to {end_ns} ns")
        while (now := min([node.due_ns for node, _, _ in turns])) <= end_ns:
            clock.time_ns = now
            is_due = True
            while is_due:
                for node, wait, cycle in turns:
                    if node.due_ns <= now:
                        node.go_on()
                        cycle(now, 0)
                        wait()
                is_due = False
                for node, _, _ in turns:
                    if node.news is not None and node.is_woken():
                        is_due = True
                        break
        clock.time_ns = end_ns
        self._pages.show()

    @contextlib.contextmanager
    def passing(self) -> Iterator[None]:
        """While a program in this block waits, the host's time passes: so clients of `trocar` and verbs work on it."""
        with sleeping_by(self.run):
            yield

    def client(self, instance: str) -> Client:
        """A handle for commands, of a person; closed with the host. Its streams pause in the host's time.

        HostError: there is no such process.
        """
        self._node(instance)
        client = Client(self.name, instance, "", self.clock.now_ns, self._numbers.next)
        self._held.callback(client.close)
        self._handles.append(client)
        return client

    def reader(self, instance: str, ring: str = "state") -> RingReader:
        """A reader of a ring; closed with the host."""
        reader = directory.reader(self.name, instance, ring)
        self._held.callback(reader.close)
        self._handles.append(reader)
        return reader

    def snapshot(self) -> HostSnapshot:
        """All as it is now, also in the middle of a motion: `restore` makes it so again. Takes some 0.1 s.

        Clients and readers that the host has made until now are part of it. HostError: what may change cannot be put
        back, for instance because a loop keeps an object of a type that procs/host/objects.py does not know.
        """
        if not private.is_kept(self.name):
            raise HostError(f"{self.name} is closed")
        if self._memory is None:
            self._take_places()
            self._memory = HostMemory(self.name)
            self._held.callback(self._memory.close)
        roots = {"clock": self.clock, "numbers": self._numbers, "loops": self.loops, "turns": self._turns,
                 "places": self._places}
        try:
            return HostSnapshot(self._memory, roots, self._handles)
        except UnknownTypeError as error:
            raise HostError(f"no snapshot of {self.name}: {error}") from error

    def _take_places(self) -> None:
        """At every mailbox: what handles share there must be in each snapshot, also if they are made after it."""
        for system, instance, what in names_of(self.name):
            if what == "mailbox" and instance in self.loops:
                self._places.append(Client(system, instance))
                self._held.callback(self._places[-1].close)
                self._places[-1].begin()

    def restore(self, snapshot: HostSnapshot, seed: int | None = None) -> None:
        """Go back to a snapshot of this host: what happens from now on is, bit by bit, what happened after it.

        `seed`: another one for the noise of sensors and the chance of packets; their generators begin anew. A client
        made since has sent nothing, `next` of a reader made since goes on with what comes. HostError: of another host.
        """
        if snapshot.memory is not self._memory or not private.is_kept(self.name):
            raise HostError(f"this is no snapshot of {self.name}, or that is closed")
        snapshot.put_back()
        for handle in self._handles:
            if handle not in snapshot.handles:
                _begin_anew(handle)
        if seed is not None:
            self.seed(seed)

    def seed(self, seed: int) -> None:
        """The noise of sensors and the chance of packets begin anew, from another seed than `emulation.seed`."""
        if isinstance(boards := self.loops.get("boards"), HostedBoards):
            boards.world.seed(seed)

    def close(self) -> None:
        """The end of it."""
        self._held.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _give_back(held: contextlib.ExitStack, pid: int) -> None:
    """Of a host that nobody has any more, whether it was closed or not; in a forked child all is the parent's."""
    if os.getpid() == pid:
        held.close()


def _refuse_coarse(document: SystemConfig) -> None:
    period_s = document.emulation.period_s if document.emulation is not None else 0.0
    psms = [arm.name for arm in document.arms if arm.type == "PSM" and document.io(arm.io).port]
    if psms and period_s > COARSEST_S:
        raise HostError(f"{', '.join(psms)}: emulation.period_s is {period_s:g} s; allowed with a PSM on boards: at "
                        f"most {COARSEST_S:g} s, or its wrist rings")


def _begin_anew(handle: Client | RingReader) -> None:
    """As one that has just been made."""
    if isinstance(handle, Client):
        handle.forget()
    else:
        handle.sequence = 0
        handle.rewind(0)


def _short(history: int) -> Make:
    """Make segments whose rings keep so many records."""
    def make(name: str, kind: str, schema: Schema, depth: int, info: dict[str, Any] | None = None) -> int:
        wanted = max(history, TOLD) if name.endswith(("~events", "~audit")) else history
        return create(name, kind, schema, min(depth, wanted) if kind == directory.RING else depth, info)

    return make


class HostPages:
    """The clock's page, and that of a supervisor which has nothing to do."""

    def __init__(self, document: SystemConfig, clock: SteppedClock) -> None:
        """The other segments of the system are there."""
        create_clock(document.name, simulated(document))
        self._segment, self._clock = clock_page(document.name, write=True), clock
        self._words, self._now = self._segment.words(), (self._segment.header.first + SCHEMA.offset("now_ns")) // 8
        self._page = ControlPage(document.name, "supervisor", write=True)
        self._page.segment.claim("supervisor")
        self._page.field("pid")[...] = os.getpid()
        self._page.show("RUNNING")
        self.show()

    def show(self) -> None:
        """What time it is."""
        self._words[self._now] = self._clock.time_ns
        self._page.field("heartbeat_ns")[...] = monotonic_ns()

    def close(self) -> None:
        """Unmap."""
        self._page.close()
        self._segment.close()
