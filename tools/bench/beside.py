"""Common parts of benchmarks for processes beside the robot: a working robot, CPU time, effect on io's period."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, closing, contextmanager
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import psutil

from trocar.shm.commands import became
from trocar.shm.mailbox.client import Client
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.control_page import ControlPage
from trocar.tools.bench.measuring import FULL, PATIENCE_S, cpu_s, home_all, seconds_since, wait_until
from trocar.tools.client.remote import Remote
from trocar.tools.output.errors import Problem
from trocar.tools.systems.supervising import StartRequest, up_meanwhile

ARMS: Final = ("PSM1", "PSM2", "PSM3", "ECM", "MTML", "MTMR")
"""Of the full system."""
PAIRS: Final = 5
TAKE_S: Final = 0.02
TURN_NS: Final = 1_000_000_000


@contextmanager
def full_robot(system: str, *sets: str) -> Iterator[None]:
    """The full KINEMATIC system on the wall clock, homed."""
    with up_meanwhile(StartRequest(FULL, system, sets=("clock=wall", *sets))):
        home_all(system)
        yield


class MovingArms:
    """Small moves of all arms, to and fro."""

    def __init__(self, system: str) -> None:
        self._clients = [Client(system, name) for name in ARMS]
        self._sizes = [7 if name.startswith("MTM") else 4 if name == "ECM" else 6 for name in ARMS]
        self._turn_ns, self._sign = 0, 1.0

    def go_on(self) -> None:
        """Reverse the motion when due."""
        now_ns = monotonic_ns()
        if now_ns < self._turn_ns:
            return
        self._turn_ns, self._sign = now_ns + TURN_NS, -self._sign
        for client, size in zip(self._clients, self._sizes, strict=True):
            client.poll()
            increment = np.zeros(size)
            increment[0] = 0.03 * self._sign
            client.send("move_jr", increment)

    def close(self) -> None:
        """Stop the motion."""
        for client in self._clients:
            client.close()


@dataclass(frozen=True, slots=True)
class RobotAtWork:
    """A system, and its frequent actions during the measurement."""

    system: str
    meanwhile: Callable[[], object]

    def wait(self, seconds: float) -> None:
        """Wait this long."""
        end = monotonic_ns() + round(seconds * 1e9)
        while monotonic_ns() < end:
            pause(TAKE_S)
            self.meanwhile()

    def process(self, instance: str) -> psutil.Process:
        """The process of an instance, as soon as it has begun."""
        with closing(ControlPage(self.system, instance)) as page:
            wait_until(lambda: int(page.get("pid")) > 0, f"{instance} to begin")
            return psutil.Process(int(page.get("pid")))

    def cpu_percent(self, seconds: float, *processes: psutil.Process) -> float:
        """CPU time that processes take in a while, 100 is one core."""
        before, begin = sum(cpu_s(process.pid) for process in processes), monotonic_ns()
        self.wait(seconds)
        used = sum(cpu_s(process.pid) for process in processes) - before
        return used / seconds_since(begin) * 100.0

    def period_ratio(self, instance: str, seconds: float, pairs: int, used: Callable[[], AbstractContextManager[Any]],
                     settle_s: float) -> float:
        """io's period (99 %) while an instance is `used`, to that while it is stopped; median of pairs by turns."""
        ratios = []
        with Remote(self.system, "supervisor") as remote:
            for _ in range(pairs):
                with used():
                    self.wait(min(settle_s, seconds))
                    with_it = self._period_p99(seconds)
                ask(remote, "stop", instance)
                ratios.append(with_it / self._period_p99(seconds))
                ask(remote, "start", instance)
        return statistics.median(ratios)

    def _period_p99(self, seconds: float) -> float:
        """99 % of io's periods in a while, s."""
        with closing(directory.reader(self.system, "io", "state")) as ring:
            ring.newest()
            seen, stamps, end = ring.stamp_ns, [], monotonic_ns() + round(seconds * 1e9)
            while monotonic_ns() < end:
                pause(TAKE_S)
                self.meanwhile()
                rows = ring.since(seen + 1)
                seen = int(rows[-1]["stamp_ns"]) if len(rows) else seen
                stamps.append(rows["stamp_ns"])
        return float(np.percentile(np.diff(np.unique(np.concatenate(stamps))), 99)) * 1e-9


def ask(remote: Remote, command: str, instance: str) -> None:
    """The supervisor starts, restarts or stops an instance; Problem when it does not."""
    reply = remote.settled(command, text=instance, timeout=PATIENCE_S)
    if reply.outcome != "done":
        raise Problem(f"{command} {instance} {became(reply.outcome)}: {reply.text}")
