"""One run of a system: make its memory, then start, watch and stop every process."""

from __future__ import annotations

import argparse
import contextlib
import logging
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from types import FrameType

from trocar.procs.document.process import ON_DEMAND
from trocar.procs.document.system import LOCKSTEP, PACED, WALL, SystemConfig
from trocar.procs.machine.paths import NoStateFolder
from trocar.procs.node.setup_error import SetupError
from trocar.procs.supervisor.children import Child
from trocar.procs.supervisor.configuration import Configuration
from trocar.procs.supervisor.forking import Template
from trocar.procs.supervisor.gui_token import told
from trocar.procs.supervisor.supervisor import Supervisor
from trocar.shm.mailbox.origins import CONFINED
from trocar.shm.memory.segment import SegmentError
from trocar.shm.system import loglines

CLOCKS = {WALL: "wall, real time", LOCKSTEP: "lockstep, simulated time as fast as the machine allows",
          PACED: "paced, simulated time, never faster than real time: a busy machine only slows it"}
log = logging.getLogger("supervisor")


@contextlib.contextmanager
def supervised(system: SystemConfig, awaits_holder: bool, template: Template) -> Iterator[Supervisor]:
    """A supervisor that removes its shared memory on every path."""
    asked: list[str] = []
    made: list[Supervisor] = []

    def hear(number: int, frame: FrameType | None) -> None:
        asked.append(f"got {signal.Signals(number).name}")
        for each in made:
            each.stopping = asked[0]

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, hear)  # before there is anything to clean up
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])  # blocked by `trocar up` while modules were loaded
    supervisor = Supervisor(system, awaits_holder, template)
    made.append(supervisor)
    supervisor.stopping = asked[0] if asked else ""
    try:
        yield supervisor
    finally:
        try:
            supervisor.stop_all()  # no effect the second time; memory must not be removed under running processes
        finally:
            supervisor.close()


def run(chosen: argparse.Namespace, configuration: Configuration, template: Template) -> int:
    """Run one system by its command line; returns the exit code."""
    loglines.begin(sys.stderr)
    with contextlib.ExitStack() as held:
        system = configuration.document(held)
        return 1 if system is None else _run(system, chosen, template)


def by_state(children: Sequence[Child]) -> str:
    """The names of processes by state: running, starting, and waiting for demand."""
    parts = {"": [c for c in children if c.is_up],
             "starting: ": [c for c in children if not (c.is_up or c.is_down)],
             "on demand: ": [c for c in children if c.is_down and c.row.start == ON_DEMAND]}
    return "; ".join(word + ", ".join(c.row.name for c in found) for word, found in parts.items() if found)


def _run(system: SystemConfig, chosen: argparse.Namespace, template: Template) -> int:
    for note in system.notes:
        log.info("%s", note)
    log.info("clock: %s", CLOCKS[system.clock])
    os.environ["TROCAR_SYSTEM"] = system.name  # connections of its processes that name no system are to this one
    os.environ.pop(CONFINED, None)  # of the process that has started us
    try:
        with supervised(system, chosen.held, template) as supervisor:
            log.info("system %s: %.1f MB of shared memory", system.name, supervisor.size / 1e6)
            try:
                supervisor.start_all()
                if not supervisor.stopping:
                    log.info("system %s is up: %s", system.name, by_state(supervisor.children))
                    if said := told(system, to_a_terminal=sys.stderr.isatty()):
                        log.info("%s", said)
                supervisor.run(chosen.seconds)
                log.log(logging.ERROR if supervisor.lost else logging.INFO, "stopping: %s", supervisor.stopping)
                failed = supervisor.lost or any(c.given_up for c in supervisor.children)
            except (SetupError, OSError) as error:  # OSError: no log file could be made
                log.error("%s", error)
                failed = True
            clean = supervisor.stop_all()
    except (SegmentError, SetupError, NoStateFolder) as error:
        log.error("%s", error)
        return 1
    return 1 if failed or not clean else 0
