"""A robot on emulated boards whose datagrams go through a pair of sockets, io on the machine's clock; one thread."""

from __future__ import annotations

import contextlib
import select
import socket
import time
from collections.abc import Callable

import numpy as np

from tests.io.boards_harness import BoardsHarness, Direct
from trocar.procs.boards.board_faults import BoardFaults
from trocar.procs.config import PROJECT_CONFIGS, load_system
from trocar.procs.io.bus.exchange import Exchange
from trocar.procs.native.io_fields import CONTROLLED, SENT
from trocar.procs.node.inputs import FOR_EVER_NS

SECOND_NS = 1_000_000_000
CALM = CONTROLLED | SENT
"""Bits of a cycle in which the other half followed at once."""


class SocketLink(Direct):
    """Replies come through `fd`, and what is sent there reaches the boards before anything else does.

    `spoil` makes what comes out of a reply: other datagrams, more of them, none. `forgets`: with other sockets, as UDP.
    """

    def __init__(self, *options) -> None:
        super().__init__(*options)
        self._connect()
        self.forgets = True
        self.spoil: Callable[[bytes], list[bytes]] = lambda reply: [reply]
        self.written: list[bytes] = []  # through the socket

    def _connect(self) -> None:
        self.ours, self.theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.ours.setblocking(False)
        self.theirs.setblocking(False)
        self.fd = self.ours.fileno()

    def send(self, datagram) -> None:
        self.deliver()
        super().send(datagram)
        while self._replies:
            for each in self.spoil(self._replies.popleft()):
                self.theirs.send(each)

    def deliver(self) -> None:
        while select.select([self.theirs], (), (), 0)[0]:
            self.written.append(self.theirs.recv(4096))
            super().send(self.written[-1])
            self._replies.clear()

    def forget_written(self) -> None:
        """`written` is what comes from now on."""
        self.deliver()
        self.written.clear()

    def forget(self) -> bool:
        if self.forgets:
            self.deliver()
            before = self.ours, self.theirs
            self._connect()  # while the old ones are open: other numbers
            for each in before:
                each.close()
        return self.forgets

    def poll(self, timeout_ms: int):
        return select.select([self.ours], (), (), timeout_ms * 1e-3)[0]

    def recv_into(self, buffer) -> int:
        return self.ours.recv_into(buffer)

    def fill(self) -> None:
        """There is no room for one more."""
        with contextlib.suppress(BlockingIOError):
            while True:
                self.ours.send(self.written[-1])

    def end(self) -> None:
        self.ours.close()
        self.theirs.close()


class SocketHarness(BoardsHarness):
    """The demo's PSM, held by its joint controllers; `bits` are those of its calls."""

    link: SocketLink

    def __init__(self) -> None:
        loaded = load_system(PROJECT_CONFIGS / "systems" / "demo.yaml")
        assert loaded.system is not None, loaded.problems
        super().__init__(loaded.system, driven=True, link=SocketLink, now_ns=time.monotonic_ns)
        # nobody judges how quick this loop is, and no sample is old because a busy machine had something else to do
        self.core._timing._start_ns += 1 << 62
        self.core._oldest_ns, self.core._stable_ns = 100 * SECOND_NS, SECOND_NS
        self.bits: list[int] = []
        for name in ("receive_and_check", "control_and_send"):
            setattr(self.core.halves, name, self._noted(getattr(self.core.halves, name)))
        self.faults = BoardFaults(self.world, self.plant)
        try:
            self.bring_up("PSM1")
            self.core.power.wake_ns = FOR_EVER_NS  # what supplies may take is long over, on the boards' clock
            self.calm()
        except BaseException:
            self.link.end()
            raise

    @property
    def exchange(self) -> Exchange:
        assert self.port.exchange is not None
        return self.port.exchange

    def _noted(self, call: Callable[..., int]) -> Callable[..., int]:
        def noted(*given) -> int:
            self.bits.append(call(*given))
            return self.bits[-1]

        return noted

    def calm(self, cycles: int = 5) -> None:
        """Nothing goes on any more: every cycle is one call."""
        for _ in range(500):
            self.bits.clear()
            self.cycle(count=cycles)
            if self.bits == [CALM] * cycles:
                return
        raise AssertionError(f"{self.bits}; {self.events}")

    def to(self, goal: np.ndarray) -> None:
        """The arm asks for these positions of its axes."""
        self.arms["PSM1"].mode[...] = 1
        self.arms["PSM1"].position[: len(goal)] = goal

    def once(self) -> list[int]:
        """The bits of the calls of one cycle."""
        self.bits.clear()
        self.cycle()
        return self.bits.copy()
