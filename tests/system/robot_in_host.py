"""A whole system under test in the test's process: what a `Robot` is where no process dies, in a part of the time."""

from __future__ import annotations

import contextlib
import logging
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from tests.system.robot import DEMO, SLOWER, Robot
from trocar.procs.config import load_system
from trocar.procs.host.host import Host
from trocar.shm.system.loglines import Stamped

HISTORY = 3000
FOR_EVER_S = 1e6
HOSTED = "hosted"
"""A clock of tests: see RobotInHost."""


class RobotInHost(Robot):
    """A `Robot` without processes: its time passes while a verb or the test waits for something."""

    def __init__(self, name: str, logs: Path, clock: str) -> None:
        super().__init__(name, logs, clock)
        self._held, self._deaths, self._dead = contextlib.ExitStack(), Counter[str](), set[str]()

    def up(self, file: Path = DEMO, *options: str, wait: bool = True) -> None:
        """See Robot; of the options of `trocar up` those that say what the system is.

        Its clock is called paced: a program that pauses is then never early, and need not look again and again.
        """
        given = list(_pairs((*SLOWER, *options)))
        loaded = load_system(file, name=self.name, sets=["clock=paced", *(v for k, v in given if k == "--set")],
                             boards=next((v for k, v in given if k == "--boards"), None),
                             search=[Path(v) for k, v in given if k == "--path"])
        assert loaded.system is not None, loaded.errors
        self.host = self._held.enter_context(Host(loaded.system, HISTORY))
        self._held.enter_context(self.host.passing())
        for name in self.host.loops:
            self._keep_log(name)
        self.host.run(0.1)

    def _keep_log(self, name: str) -> None:
        """What its process would write into its file."""
        (self.logs / self.name).mkdir(exist_ok=True)
        handler, logger = logging.FileHandler(self.logs / self.name / f"{name}.log"), logging.getLogger(name)
        handler.setFormatter(Stamped(name))
        logger.addHandler(handler)
        self._held.callback(handler.close)
        self._held.callback(logger.removeHandler, handler)

    def kill(self, instance: str) -> int:
        """It does nothing any more, until the test asks for the pid of its successor."""
        before = self.pid(instance)
        self.host.delay(instance, FOR_EVER_S)
        self._dead.add(instance)
        return before

    def pid(self, instance: str) -> int:
        """Another number after each death."""
        if instance in self._dead:
            self._dead.remove(instance)
            self._deaths[instance] += 1
            self.host.restart(instance, killed=True)
        return super().pid(instance) + self._deaths[instance]

    def down(self) -> int:
        """The end of it; its pids are made up."""
        self.pids.clear()
        self._held.close()
        return 0


def _pairs(options: tuple[str, ...]) -> Iterator[tuple[str, str]]:
    rest = iter(options)
    for option in rest:
        assert option in ("--set", "--boards", "--path"), f"{option} is for a system of processes"
        yield option, next(rest)
