"""Nodes for the loops of a host, which share a process: a common clock, and turns instead of sleep."""

from __future__ import annotations

import socket
from collections.abc import Callable

from trocar.procs.document.system import SystemConfig
from trocar.procs.node.node import Node
from trocar.procs.node.pacing import AFTER_OTHERS_NS
from trocar.shm.time.lockstep import EPOCH_NS


class SteppedClock:
    """The clock of a host, which sets its time."""

    simulated = True
    spin_ns = 0

    def __init__(self) -> None:
        self.time_ns = EPOCH_NS
        self.wakeup: socket.socket | None = None

    def now_ns(self) -> int:
        """The host's time."""
        return self.time_ns

    def sleep_until(self, deadline_ns: int, stopped: Callable[[], bool]) -> None:
        """Raise an error, because loops in a host must not sleep: see HostedNode.tick."""
        raise RuntimeError("a loop in a host sleeps by Node.tick only")


class HostedNode(Node):
    """A node whose `tick` only records when its loop is due; the host then calls the loop."""

    clock: SteppedClock

    def __init__(self, document: SystemConfig, name: str, clock: SteppedClock) -> None:
        super().__init__(document, name, clock)
        self.due_ns = 0
        """Time of its next cycle."""
        self.news: Callable[[], bool] | None = None
        """Returns True if its next cycle is to be earlier."""
        self._end_ns = 0

    def tick(self, serve: Callable[[int], bool] | None = None, news: Callable[[], bool] | None = None,
             periods: int = 1) -> bool:
        """See Node.tick; sets `due_ns` and returns at once."""
        self._end_ns = self.due_ns = self.pacing.end_of_work(self.clock.time_ns, periods)
        self.news = news
        return True

    def look_for_news(self) -> None:
        """With news it is due earlier: after all cycles of now, at the earliest `quickest_ns` after its last one."""
        if self.news is not None and self.news():
            soonest = max(self.clock.time_ns, self.now_ns + self.pacing.quickest_ns)
            self.due_ns = min(self.due_ns, soonest + AFTER_OTHERS_NS)

    def go_on(self) -> None:
        """Begin a cycle."""
        now = self.now_ns = self.clock.time_ns
        if now < self._end_ns:
            self.pacing.early(now)
        self.pacing.begin_work(now)
