"""The supervisor: checks the configuration, makes shared memory, starts, watches, restarts and stops every process."""

from __future__ import annotations

import argparse
import contextlib
import logging
import math
import os
import signal
import socket
import sys
import zlib
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import FrameType

from procs import codes, lifecycle
from procs.config import load_system
from procs.document.system import LOCKSTEP, PACED, WALL, Process, SystemConfig
from procs.manifest import THIRD_PARTY, hung_s, late_s, proc
from procs.paths import log_folder
from procs.realtime import in_words, lacking, realtime
from procs.supervisor import memory
from procs.supervisor.children import Child
from procs.supervisor.clearing import Clearings
from procs.supervisor.cores import core_time_ns
from procs.supervisor.judge import HUNG, LATE, Judge, JudgedProcess
from procs.supervisor.shared_pages import lock_shared
from procs.udp_holders import holders
from shm import directory, loglines
from shm.audit import Audit
from shm.clock import monotonic_ns, pause
from shm.control_page import ControlPage
from shm.events import Events
from shm.layout import shorten
from shm.lockstep import Timekeeper
from shm.mailbox import Mailbox
from shm.ring import RingWriter
from shm.segment import Make, SegmentError

BEAT_S = 0.02
BARRIER_S = 60.0
CLOCKS = {WALL: "wall, real time", LOCKSTEP: "lockstep, simulated time as fast as the machine allows",
          PACED: "paced, simulated time, never faster than real time: a busy machine only slows it"}
SIMULATED_LOST = 10.0  # times `supervisor_lost_s`: nothing is in danger, and the machine may be busy
BUS_PORT = 1394
log = logging.getLogger("supervisor")


class SetupFailed(Exception):
    """A process did not come up; the message says which and why."""


class Supervisor:
    """One running system."""

    def __init__(self, system: SystemConfig) -> None:
        """Make all shared memory; SegmentError when the name is taken or memory is full."""
        self.system = system
        memory.trust(system.service_user)
        self.stopping = ""
        self.lost = False  # our processes have ended because we were held up
        self.judge, self._beat_ns = Judge(), 0
        self._name = memory.hold_name(system.name)
        try:
            self._make(memory.maker(system.group))
        except BaseException:  # nobody has us yet to close us
            self._name.close()
            raise

    def _make(self, make: Make) -> None:
        system = self.system
        left = memory.clear_left_over(system.name)
        if left:
            log.warning("cleared %d segments that a dead system left", left)
        folder = log_folder(os.environ, system.name)
        folder.mkdir(parents=True, exist_ok=True)
        self.size = memory.create_all(system, make)
        try:
            self._begin(folder, make)
        except BaseException:
            memory.remove_all(system.name)
            raise

    def _begin(self, folder: Path, make: Make) -> None:
        """Take our places in the memory that is there now."""
        system = self.system
        self.page = ControlPage(system.name, "supervisor", write=True)
        self.page.segment.claim("supervisor")
        self.page.field("pid")[...] = os.getpid()
        row = Process("supervisor", "supervisor", BEAT_S, priority=max([0, *(p.priority for p in system.processes)]))
        self._granted = realtime(row, system.clock)
        self.page.field("policy")[...] = in_words(self._granted)
        self.keeper = None if system.clock == WALL else Timekeeper(system.name, memory.simulated(system), make)
        self.size += self.keeper.size if self.keeper is not None else 0
        self.beat()
        self.events = Events(self._writes("events"), self.now_ns, loglines.into(log))
        self.mailbox = Mailbox(system.name, "supervisor", "supervisor", audit=Audit(self._writes("audit"), self.now_ns))
        self._state = self._writes("state")
        self._rows = tuple(row for row in system.processes if row.kind not in THIRD_PARTY)  # those are ours
        self.children = [self._child(row, folder) for row in self._rows]
        self._clearings = Clearings(system)

    def _writes(self, topic: str) -> RingWriter:
        return directory.writer(self.system.name, "supervisor", topic, "supervisor")

    def _child(self, row: Process, folder: Path) -> Child:
        path = folder / f"{row.name}.log"
        if path.exists():
            path.replace(path.with_suffix(".previous.log"))
        return Child(self.system.name, row, ControlPage(self.system.name, row.name, write=True), path)

    def now_ns(self) -> int:
        """The system's time."""
        return self.keeper.now_ns() if self.keeper is not None else monotonic_ns()

    def beat(self) -> None:
        """Show that we live; always in real time. Held up for so long that our processes have ended, we end as well."""
        now = monotonic_ns()
        passed_s, self._beat_ns = (now - self._beat_ns) * 1e-9 if self._beat_ns else 0.0, now
        lost_s = self.system.supervisor_lost_s * (1.0 if self.system.clock == WALL else SIMULATED_LOST)
        if passed_s > lost_s and not self.stopping:
            self.lost = True
            self.stopping = f"was held up for {passed_s:.1f} s; its processes have ended; start the system again"
        self.page.field("heartbeat_ns")[...] = now

    def start_all(self) -> None:
        """Start in order, each after those it needs are up; SetupFailed says what did not come up."""
        self.page.show("STARTING")
        for wave in _waves(self._rows):
            children = [c for c in self.children if c.row in wave]
            for child in children:
                child.start()
                self.beat()
            self._wait(lambda group=children: self._all_up(group), BARRIER_S)  # type: ignore[misc]  # bound default
            if self.stopping:
                return
            if late := [c.row.name for c in children if not c.ready]:
                raise SetupFailed(f"{', '.join(late)}: not ready within {BARRIER_S:.0f} s")
        self.page.show("RUNNING")
        self._show()
        if self.keeper is None:  # simulated time needs no rights
            shared = lock_shared(self.system.name, [child.pid for child in self.children])
            self.page.field("policy")[...] = in_words([*self._granted, shared])
            policies = {child.row.name: bytes(child.page.get("policy")).decode() for child in self.children}
            if rights := lacking(policies):
                log.warning("%s", rights)

    def _all_up(self, children: list[Child]) -> bool:
        for child in children:
            if child.popen is None or child.popen.poll() is not None:
                child.reap()
                raise SetupFailed(f"{child.row.name}: {child.reason}; see trocar logs {child.row.name}")
        return all(child.ready for child in children)

    def _wait(self, done: Callable[[], bool], seconds: float, to_the_end: bool = False) -> bool:
        """Wait for `done`, at most so long; given up when asked to stop, unless it is `to_the_end`."""
        end = monotonic_ns() + round(seconds * 1e9)
        while monotonic_ns() < end and (to_the_end or not self.stopping):
            if done():
                return True
            self.let_time_pass()
            self.beat()
        return done() if to_the_end or not self.stopping else False

    def let_time_pass(self) -> None:
        """One beat's worth of real time. In simulated time say who takes part: whoever runs."""
        if self.keeper is None:
            pause(BEAT_S)
            return
        self.keeper.admit([child.row.name for child in self.children if child.ready])
        self.keeper.let_pass(BEAT_S)

    def run(self, seconds: float | None) -> None:
        """Watch until asked to stop, or for so many seconds of real time."""
        end = monotonic_ns() + round(seconds * 1e9) if seconds is not None else None
        while not self.stopping:
            self._commands()
            self._watch()
            self._judge()
            self._clearings.beat(monotonic_ns())
            self.let_time_pass()
            self.beat()
            if end is not None and monotonic_ns() >= end:
                self.stopping = f"{seconds:g} s are over"

    def _commands(self) -> None:
        for command in self.mailbox.drain():
            child = next((c for c in self.children if c.row.name == command.text), None)
            if command.name == "stop":
                self.stopping = "asked to stop"
                command.accept()
            elif child is None:
                command.refuse(f"no instance {command.text}; there are {', '.join(c.row.name for c in self.children)}")
            else:
                child.ask_to_stop()
                child.kill_at_ns = monotonic_ns() + round(proc(child.row.kind).stop_s * 1e9)
                child.failures, child.given_up = 0, False
                child.start()
                command.accept()
                self._show()

    def _watch(self) -> None:
        for child in self.children:
            child.kill_when_due()
            if how := child.reap():
                planned = "restarting" if child.restart_at_ns else "not restarted"
                self.events.report(codes.PROCESS_ENDED, f"{child.row.name} ended: {how}; {planned}", child.row.name)
                self._show()
            if child.restart_when_due():
                log.info("%s started again (pid %d)", child.row.name, child.pid)
                self.events.status(f"{child.row.name} started again", child.row.name)
                self._show()

    def _judge(self) -> None:
        """Report who is late, kill who hangs."""
        for verdict in self.judge.beat(monotonic_ns(), self._members()):
            child = next(c for c in self.children if c.row.name == verdict.name)
            name, seconds, allowed_s = verdict.name, verdict.silent_s, late_s(child.row)
            if verdict.what == LATE:
                text = f"{name} is late: silent for {seconds:.2f} s, allowed are {allowed_s:g} s"
                self.events.report(codes.PROCESS_LATE, text, name, value=seconds, limit=allowed_s)
            elif verdict.what == HUNG:
                log.error("%s hangs: silent for %.2f s; killing it", name, seconds)
                child.kill_hung(seconds)
                if self.keeper is not None and name == self.keeper.table.server:
                    self.judge.forget(self.keeper.table.asking)
            else:
                log.info("%s resumes after %.2f s", name, seconds)
                self.events.status(f"{name} resumes after {seconds:.2f} s", name)

    def _members(self) -> Iterator[JudgedProcess]:
        """Who is to be judged: all that run. In simulated time nobody is late, and who has to wait does not hang."""
        keeper = self.keeper
        for child in self.children:
            if child.state != lifecycle.RUNNING or not child.ready:
                continue
            name, mark, hung_ns = child.row.name, int(child.page.get("heartbeat_ns")), hung_s(child.row) * 1e9
            if keeper is None:
                yield JudgedProcess(name, mark, late_s(child.row) * 1e9, hung_ns)
            else:
                server = keeper.table.server if name in keeper.table.asking else ""
                yield JudgedProcess(name, mark, math.inf, hung_ns, partial(core_time_ns, child.pid), server)

    def _show(self) -> None:
        for i, child in enumerate(self.children):
            values = {"instance": child.row.name.encode(), "kind": child.row.kind.encode(),
                      "lifecycle": child.state.encode(), "pid": child.pid, "restarts": child.restarts,
                      "exit_reason": shorten(child.reason, 120)}
            for name, value in values.items():
                self._state.field(name)[i] = value
        self._state.publish(self.now_ns())

    def stop_all(self) -> bool:
        """Stop in reverse order: ask, wait the tabled time, kill. True when nobody had to be killed."""
        self.page.show("STOPPING")
        clean = True
        for wave in reversed(_waves(self._rows)):
            children = [c for c in self.children if c.row in wave]
            for child in children:
                child.ask_to_stop()
            limit = max((proc(c.row.kind).stop_s for c in children), default=0.0)
            # Asked twice, it takes no less time: an io that is killed has not switched anything off.
            self._wait(lambda group=children: _all_ended(group), limit, True)  # type: ignore[misc]  # bound default
            for child in children:
                if child.popen is not None:
                    log.warning("%s did not end within %.0f s, killed", child.row.name, limit)
                    child.kill()
                    clean = False
            self._wait(lambda group=children: _all_ended(group), 5.0, True)  # type: ignore[misc]  # bound default
        return clean

    def close(self) -> None:
        """Remove all shared memory, then give the name back."""
        memory.remove_all(self.system.name)
        self._name.close()


def _all_ended(children: list[Child]) -> bool:
    for child in children:
        child.reap()
    return all(child.popen is None for child in children)


def _waves(rows: tuple[Process, ...]) -> list[list[Process]]:
    """Rows in start order: each wave needs only instances of earlier ones."""
    waves: list[list[Process]] = []
    left, up = list(rows), set[str]()
    known = {row.name for row in rows}
    while left:
        wave = [row for row in left if all(name in up or name not in known for name in row.after)]
        if not wave:
            raise SetupFailed(f"{', '.join(r.name for r in left)}: each waits for another to start first")
        waves.append(wave)
        up |= {row.name for row in wave}
        left = [row for row in left if row.name not in up]
    return waves


def free_address(system: str) -> Callable[[int], str]:
    """Addresses 127.x.y.16k for the emulated buses of a system, not in use now; x.y follows from the name."""
    seed = zlib.crc32(system.encode())

    def address(bus: int) -> str:
        for attempt in range(256):
            number = (seed + attempt * 7919) % 0xFE00
            candidate = f"127.{1 + number // 256}.{number % 256}.{16 * (bus + 1)}"
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe, contextlib.suppress(OSError):
                probe.bind((candidate, BUS_PORT))
                return candidate
        others = "; ".join(map(str, holders(BUS_PORT))) or "every address that was tried is taken"
        raise SetupFailed(f"no free loopback address with port {BUS_PORT} for an emulated bus: {others}")

    return address


@contextlib.contextmanager
def supervised(system: SystemConfig) -> Iterator[Supervisor]:
    """A supervisor that removes its shared memory on every path."""
    asked: list[str] = []
    made: list[Supervisor] = []

    def hear(number: int, frame: FrameType | None) -> None:
        asked.append(f"got {signal.Signals(number).name}")
        for each in made:
            each.stopping = asked[0]

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, hear)  # before there is anything to leave behind
    supervisor = Supervisor(system)
    made.append(supervisor)
    supervisor.stopping = asked[0] if asked else ""
    try:
        yield supervisor
    finally:
        try:
            supervisor.stop_all()  # does nothing a second time; no memory is removed under running processes
        finally:
            supervisor.close()


def arguments() -> argparse.Namespace:
    """The command line; `trocar up` passes its own options on."""
    parser = argparse.ArgumentParser(prog="procs.supervisor.loop", description="Run one system; see trocar up --help.")
    parser.add_argument("file", type=Path)
    parser.add_argument("--system")
    parser.add_argument("--boards", choices=["emulated"])
    parser.add_argument("--path", type=Path, action="append", default=[])
    parser.add_argument("--set", dest="sets", action="append", default=[])
    parser.add_argument("--for", dest="seconds", type=float)
    return parser.parse_args()


def main() -> None:
    """Exit code 0: stopped as asked, 1: configuration, setup or a death without return."""
    chosen = arguments()
    loglines.begin(sys.stderr)
    name = chosen.system or "trocar"
    try:
        loaded = load_system(chosen.file, search=chosen.path, boards=chosen.boards, sets=chosen.sets, name=name,
                             bus_address=free_address(name))
    except SetupFailed as error:
        log.error("%s", error)
        sys.exit(1)
    for problem in (*loaded.errors, *loaded.warnings):  # what is in the way comes first
        log.log(logging.ERROR if problem in loaded.errors else logging.WARNING, "%s", problem)
    if loaded.errors or loaded.system is None:
        log.error("nothing was started")
        sys.exit(1)
    sys.exit(_run(loaded.system, chosen.seconds))


def _run(system: SystemConfig, seconds: float | None) -> int:
    for note in system.notes:
        log.info("%s", note)
    log.info("clock: %s", CLOCKS[system.clock])
    try:
        with supervised(system) as supervisor:
            log.info("system %s: %.1f MB of shared memory", system.name, supervisor.size / 1e6)
            try:
                supervisor.start_all()
                if not supervisor.stopping:
                    log.info("system %s is up: %s", system.name, ", ".join(c.row.name for c in supervisor.children))
                supervisor.run(seconds)
                log.log(logging.ERROR if supervisor.lost else logging.INFO, "stopping: %s", supervisor.stopping)
                failed = supervisor.lost or any(c.given_up for c in supervisor.children)
            except (SetupFailed, OSError) as error:  # OSError: no process or log file could be made
                log.error("%s", error)
                failed = True
            clean = supervisor.stop_all()
    except (SegmentError, SetupFailed) as error:
        log.error("%s", error)
        return 1
    return 1 if failed or not clean else 0


if __name__ == "__main__":
    main()
