"""A whole system in this process: its loops run one after the other when due, on a stepped clock.

    with Host(document) as host:
        psm = host.client("PSM1")
        psm.send("state_command", (), "enable")
        host.run(0.5)

The behaviour is that of lock-step between processes. Its shared memory has no names (shm/memory/private.py), so nothing
remains, however the process ends. There is no supervisor: an error in a loop ends the host.
"""

from __future__ import annotations

import contextlib
import os
import weakref
from collections.abc import Iterator
from typing import Any

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
from trocar.shm.memory.closable import Closable
from trocar.shm.memory.layout import Schema
from trocar.shm.memory.segment import Make, create, names_of
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, sleeping_by
from trocar.shm.time.control_page import ControlPage
from trocar.shm.time.lockstep import SCHEMA, clock_page, create_clock

HISTORY = 8
"""Default number of records that rings keep."""
TOLD = 128
"""Minimum for events and audits, each of which matters: a second or two of them."""


COARSEST_S = 0.002
"""Longest physics step for a PSM on boards: with longer ones the light wrist joints oscillate, and io trips."""


FIRST_NUMBER = 1 << 31
"""Above the numbers that this process gives elsewhere."""


class CommandNumbers:
    """Numbers of operators' commands in a host, the same in each run (shm/mailbox/origins.py)."""

    def __init__(self) -> None:
        self._count = 0

    def next(self) -> int:
        """A number that is unique among the commands of this host."""
        self._count += 1
        return os.getpid() << 32 | FIRST_NUMBER + self._count


class Host(Closable):
    """One system. Time begins at EPOCH_NS (shm/time/lockstep.py) and passes in `run` only."""

    def __init__(self, document: SystemConfig, history: int = HISTORY) -> None:
        """HostError for systems that cannot run here: real boards, users' processes, PSMs with coarse physics.

        `history`: number of records that rings keep; at least TOLD for events and audits.
        """
        self.document, self.name = document, document.name
        self.clock = SteppedClock()
        self.loops: dict[str, Loop] = {}
        self._handles: list[Client | RingReader] = []
        self._numbers = CommandNumbers()
        self._memory: HostMemory | None = None
        self._places: list[Client] = []  # one per mailbox: it holds the place that all handles share there
        self._turns: dict[str, tuple[HostedNode, Loop]] = {}
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
        self._held.callback(node.close)
        self._begin(node)
        loops, name = self.loops, node.name
        self._held.callback(lambda: loops[name].quit())

    def _begin(self, node: HostedNode) -> None:
        boards = self.loops.get("boards")
        loop = made(node, boards if isinstance(boards, HostedBoards) else None)
        loop.begin()
        loop.tick()
        self.loops[node.name] = loop
        self._turns[node.name] = node, loop

    def restart(self, instance: str, *, killed: bool = False) -> None:
        """Make the loop of an instance again, as after a restart of its process; `killed`: without closing the old one.

        Earlier snapshots become invalid. HostError: there is no such instance, or it is the boards.
        """
        node = self._node(instance)
        if instance == "boards":
            raise HostError("boards do not restart in a host")
        if not killed:
            self.loops[instance].quit()
        node.give_back()
        self._memory, self._places = None, []
        self._begin(node)

    def delay(self, instance: str, seconds: float) -> None:
        """Delay the next cycle of an instance, as if its process had no CPU time. HostError: no such instance."""
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
        """Let this much time pass."""
        self.run_until(self.clock.time_ns + round(seconds * 1e9))

    def run_until(self, end_ns: int) -> None:
        """Let time pass up to and including `end_ns`. HostError: that is in the past, or the host is closed."""
        clock, turns = self.clock, list(self._turns.values())
        if end_ns < clock.time_ns or not private.is_kept(self.name):
            raise HostError(f"{self.name} is closed" if not private.is_kept(self.name) else
                            f"the time of {self.name} is {clock.time_ns} ns, it does not go back to {end_ns} ns")
        for node, _ in turns:
            node.look_for_news()  # commands since the last run
        while (now := min([node.due_ns for node, _ in turns])) <= end_ns:
            clock.time_ns = now
            for node, loop in turns:
                if node.due_ns <= now:
                    node.go_on()
                    loop.update()
                    loop.tick()
            for node, _ in turns:
                node.look_for_news()
        clock.time_ns = end_ns
        self._pages.show()

    @contextlib.contextmanager
    def passing(self) -> Iterator[None]:
        """Let the host's time pass while a program in this block waits, so that clients and verbs of `trocar` work."""
        with sleeping_by(self.run):
            yield

    def client(self, instance: str) -> Client:
        """A handle for operators' commands; closed with the host. Pauses of its streams are measured in host time.

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
        """The present state of the host for `restore`, also in the middle of a motion. Takes about 0.1 s.

        It includes clients and readers that the host has made so far. HostError: some state cannot be restored, for
        instance because a loop keeps an object of a type that is unknown to procs/host/objects.py.
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
        """Take a place at every mailbox: each snapshot must contain it, also for handles that are made later."""
        for system, instance, what in names_of(self.name):
            if what == "mailbox" and instance in self.loops:
                self._places.append(Client(system, instance))
                self._held.callback(self._places[-1].close)
                self._places[-1].begin()

    def restore(self, snapshot: HostSnapshot, seed: int | None = None) -> None:
        """Go back to a snapshot of this host; the continuation is then bit by bit the same as after the snapshot.

        `seed`: restart the generators of sensor noise and packet faults with another seed. A client made after the
        snapshot has then sent nothing; `next` of a later reader continues with new records. HostError: the snapshot is
        of another host, or invalid.
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
        """Restart the generators of sensor noise and packet faults with a seed other than `emulation.seed`."""
        if isinstance(boards := self.loops.get("boards"), HostedBoards):
            boards.world.seed(seed)

    def close(self) -> None:
        """Close the host with all its loops, handles and memory."""
        self._held.close()


def _give_back(held: contextlib.ExitStack, pid: int) -> None:
    """Close an unreferenced host that may still be open; not in a forked child, where all belongs to the parent."""
    if os.getpid() == pid:
        held.close()


def _refuse_coarse(document: SystemConfig) -> None:
    period_s = document.emulation.period_s if document.emulation is not None else 0.0
    psms = [arm.name for arm in document.arms if arm.type == "PSM" and document.io(arm.io).port]
    if psms and period_s > COARSEST_S:
        raise HostError(f"{', '.join(psms)}: emulation.period_s is {period_s:g} s; allowed with a PSM on boards: at "
                        f"most {COARSEST_S:g} s, or its wrist rings")


def _begin_anew(handle: Client | RingReader) -> None:
    """Reset a handle to its state after creation."""
    if isinstance(handle, Client):
        handle.forget()
    else:
        handle.sequence = 0
        handle.rewind(0)


def _short(history: int) -> Make:
    """A function that makes segments whose rings keep at most this many records."""
    def make(name: str, kind: str, schema: Schema, depth: int, info: dict[str, Any] | None = None) -> int:
        wanted = max(history, TOLD) if name.endswith(("~events", "~audit")) else history
        return create(name, kind, schema, min(depth, wanted) if kind == directory.RING else depth, info)

    return make


class HostPages:
    """The page of the clock, and that of a supervisor, which does not exist here."""

    def __init__(self, document: SystemConfig, clock: SteppedClock) -> None:
        """The other segments of the system must exist."""
        create_clock(document.name, simulated(document))
        self._segment, self._clock = clock_page(document.name, write=True), clock
        self._words, self._now = self._segment.words(), (self._segment.header.first + SCHEMA.offset("now_ns")) // 8
        self._page = ControlPage(document.name, "supervisor", write=True)
        self._page.segment.claim("supervisor")
        self._page.field("pid")[...] = os.getpid()
        self._page.show("RUNNING")
        self.show()

    def show(self) -> None:
        """Publish the time, and update the heartbeat."""
        self._words[self._now] = self._clock.time_ns
        self._page.field("heartbeat_ns")[...] = monotonic_ns()

    def close(self) -> None:
        """Unmap."""
        self._page.close()
        self._segment.close()
