"""A whole system in this process: its loops one after the other, as their time comes, on a clock that is stepped.

    with Host(document) as host:
        psm = host.client("PSM1")
        psm.send("state_command", (), "enable")
        host.run(0.5)

What happens is what happens in lock-step between processes. Its shared memory has no names (shm/private.py): nothing is
left of it, whatever becomes of the process. There is no supervisor: a loop that raises an error ends the host.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any, Self

from procs.document.system import SystemConfig
from procs.host.loops import HostedBoards, HostError, made
from procs.host.node import HostedNode, SteppedClock
from procs.manifest import proc
from procs.runtime import Loop
from procs.supervisor import memory
from shm import directory, private
from shm.client import Client
from shm.layout import Schema
from shm.ring import RingReader
from shm.segment import Make, create

HISTORY = 8
"""Records that rings keep but those of events, unless somebody wants more."""


class Host:
    """One system. Time begins at EPOCH_NS (shm/lockstep.py) and passes in `run` only."""

    def __init__(self, document: SystemConfig, history: int = HISTORY) -> None:
        """HostError for what cannot run here: real boards, users' processes. `history`: records that rings keep."""
        self.document, self.name = document, document.name
        self.clock = SteppedClock()
        self.loops: dict[str, Loop] = {}
        self._turns: list[tuple[HostedNode, Callable[[], bool], Callable[[int, int], None]]] = []
        self._held = contextlib.ExitStack()
        wanted = [row for row in document.processes if proc(row.kind).in_time]
        if users := [row.name for row in document.users]:
            raise HostError(f"{', '.join(users)}: processes of users do not run in a host")
        private.keep(self.name)
        try:
            self._held.callback(private.forget, self.name)
            memory.create_all(document, _short(history))
            for row in wanted:
                self._add(HostedNode(row.kind, self.name, row.name, self.clock))
        except BaseException:
            self._held.close()
            raise

    def _add(self, node: HostedNode) -> None:
        self._held.callback(node.leave)
        boards = self.loops.get("boards")
        loop = made(node, boards if isinstance(boards, HostedBoards) else None)
        self._held.callback(loop.close)
        node.ready()
        loop.wait()
        self.loops[node.name] = loop
        self._turns.append((node, loop.wait, loop.cycle))

    @property
    def now_ns(self) -> int:
        """The system's time."""
        return self.clock.time_ns

    def run(self, seconds: float) -> None:
        """Let so much time pass."""
        self.run_until(self.clock.time_ns + round(seconds * 1e9))

    def run_until(self, end_ns: int) -> None:
        """Let time pass up to this moment; what is due then is done."""
        clock, turns = self.clock, self._turns
        while (now := min([node.due_ns for node, _, _ in turns])) <= end_ns:
            clock.time_ns = now
            for node, wait, cycle in turns:
                if node.due_ns <= now:
                    node.go_on()
                    cycle(now, 0)
                    wait()
            while any(node.is_woken() for node, _, _ in turns):
                for node, wait, cycle in turns:
                    if node.due_ns <= now:
                        node.go_on()
                        cycle(now, 0)
                        wait()
        clock.time_ns = end_ns

    def client(self, instance: str) -> Client:
        """A handle for commands, of a person; closed with the host."""
        client = Client(self.name, instance)
        self._held.callback(client.close)
        return client

    def reader(self, instance: str, ring: str = "state") -> RingReader:
        """A reader of a ring; closed with the host."""
        reader = directory.reader(self.name, instance, ring)
        self._held.callback(reader.close)
        return reader

    def close(self) -> None:
        """The end of it."""
        self._held.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _short(history: int) -> Make:
    """Make segments whose rings keep so many records, but for those of which each counts."""
    def make(name: str, kind: str, schema: Schema, depth: int, info: dict[str, Any] | None = None) -> int:
        is_complete = name.endswith(("~events", "~audit")) or kind != directory.RING
        return create(name, kind, schema, depth if is_complete else min(depth, history), info)

    return make
