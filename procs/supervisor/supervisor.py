"""One running system: its shared memory, its processes from start to stop, requests about them, silent processes."""

from __future__ import annotations

import logging
import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, closing
from functools import partial
from typing import Final

from trocar.procs.config.loading.processes import ROBOTS
from trocar.procs.document.process import ELSEWHERE, ON_DEMAND
from trocar.procs.document.system import WALL, Process, SystemConfig
from trocar.procs.machine.log_files import put_run_aside
from trocar.procs.machine.paths import made_log_folder, made_recordings_folder
from trocar.procs.machine.verb_lines import REMEDY, verb_line
from trocar.procs.node.realtime import in_words, lacking, realtime, step_back
from trocar.procs.supervisor import memory
from trocar.procs.supervisor.children import Child, Demand, Ending, missing, waves
from trocar.procs.supervisor.forking import Template, reap_orphans
from trocar.procs.supervisor.gui_token import gui_token
from trocar.procs.supervisor.judge import HUNG, LATE, Judge, JudgedProcess
from trocar.procs.supervisor.listening import Listening
from trocar.procs.supervisor.log_keeper import LogKeeper
from trocar.procs.supervisor.memory import Clearings
from trocar.procs.supervisor.os_process import OsProcess
from trocar.procs.supervisor.requests import Requests
from trocar.procs.supervisor.shared_pages import lock_shared
from trocar.procs.supervisor.systemd import Notifier
from trocar.procs.tables import codes, lifecycle
from trocar.procs.tables.manifest import SIMULATED_LOST, hung_s, late_s, proc
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.audit import Audit
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.memory.layout import shorten
from trocar.shm.memory.segment import Make
from trocar.shm.ring.ring import RingWriter
from trocar.shm.system import directory, loglines
from trocar.shm.system.events import Events
from trocar.shm.system.subscriptions import Subscriptions
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.control_page import ControlPage
from trocar.shm.time.lockstep import Timekeeper

BEAT_S: Final = 0.02
QUICK_BEAT_S: Final = 0.002  # during start and stop, when processes wait for others
GONE_S: Final = 5.0  # the longest that a killed process takes to be gone
log = logging.getLogger("supervisor")


class SetupFailed(Exception):
    """A process did not start; the message names it, and the reason."""


def highest_priority(rows: Sequence[Process]) -> int:
    """The supervisor's priority: the highest of all processes that drive robots, so that it can kill one that hangs.

    Not that of emulated boards, which is above io's: each of our beats would stall io for a large part of its period.
    """
    return max((row.priority for row in rows if proc(row.kind).priority in ROBOTS), default=0)


class Supervisor:
    """One running system."""

    def __init__(self, system: SystemConfig, awaits_holder: bool = False, template: Template | None = None) -> None:
        """Make all shared memory; SegmentError when the name is taken or memory is full, AddressTaken.

        `awaits_holder`: simulated time does not start until a program holds it back (shm/time/held_time.py).
        """
        self.system, self._awaits_holder = system, awaits_holder
        self._template = template or Template()
        memory.trust(system.service_user)
        self.stopping = ""
        self.lost = False  # our processes have ended because we were stalled
        self.judge, self._beat_ns = Judge(), 0
        self._systemd = Notifier(os.environ)
        with ExitStack() as held:
            self._folder = made_log_folder(os.environ, system.name)
            if system.recorder is not None:
                made_recordings_folder(os.environ, system.name, system.recorder.folder)
            held.enter_context(memory.hold_name(system.name))
            put_run_aside(self._folder, system.logs.keep)
            held.enter_context(gui_token(system))
            self._listening = {row.name: held.enter_context(closing(Listening(row))) for row in system.processes}
            self._make(memory.maker(system.group))
            self._log_keeper = held.enter_context(closing(LogKeeper(self._folder, system.logs)))
            self._held = held.pop_all()  # until here `close` cannot be called

    def _make(self, make: Make) -> None:
        system = self.system
        left = memory.clear_left_over(system.name)
        if left:
            log.warning("removed %d segments that a crashed system left", left)
        self.size = memory.create_all(system, make)
        try:
            self._begin(make)
        except BaseException:
            memory.remove_all(system.name)
            raise

    def _begin(self, make: Make) -> None:
        """Claim our segments in the new memory."""
        system = self.system
        self.page = ControlPage(system.name, "supervisor", write=True)
        self.page.segment.claim("supervisor")
        self.page.field("pid")[...] = os.getpid()
        self._row = Process("supervisor", "supervisor", BEAT_S, priority=highest_priority(system.processes),
                            cpus=system.cpus)
        self._granted = realtime(self._row, system.clock)
        self.page.field("policy")[...] = in_words(self._granted)
        self.keeper = None if system.clock == WALL else Timekeeper(system.name, memory.simulated(system), make)
        if self.keeper is not None:
            self.size += self.keeper.size
            self.keeper.hold(True)  # until all are up, so that every run begins at the same instant
        self.beat()
        self.events = Events(self._writes("events"), self.now_ns, loglines.into(log))
        self.mailbox = Mailbox(system.name, "supervisor", COMMANDS["supervisor"],
                               audit=Audit(self._writes("audit"), self.now_ns))
        self._state = self._writes("state")
        self._rows = tuple(row for row in system.processes if row.start != ELSEWHERE)  # those are ours
        self._pages: dict[str, ControlPage] = {}
        self.children = [self._child(row) for row in self._rows]
        self._demands = [self._demand(child) for child in self.children if child.row.start == ON_DEMAND]
        self._requests, self._clearings = Requests(self.children), Clearings(system)
        self._shown: list[tuple[str, int, int, str, bool]] = []
        self._awaited: list[Child] = []  # processes that must come up now, or the start fails
        self.killed = 0  # number of processes that took too long to end

    def _writes(self, topic: str) -> RingWriter:
        return directory.writer(self.system.name, "supervisor", topic, "supervisor")

    def _child(self, row: Process) -> Child:
        path = self._folder / f"{row.name}.log"
        page = self._pages[row.name] = ControlPage(self.system.name, row.name, write=True)
        process = OsProcess(self.system.name, row, page, path, self._template, self._listening[row.name].sockets)
        return Child(row, process)

    def _demand(self, child: Child) -> Demand:
        subscriptions, children = Subscriptions(self._pages[child.row.name]), {c.row.name: c for c in self.children}
        listening = self._listening[child.row.name]

        def is_wanted(is_refused: bool, is_last: bool) -> bool:
            subscriptions.look()
            return (listening.is_wanted(monotonic_ns(), child.state == lifecycle.RUNNING, is_refused, is_last)
                    or bool(subscriptions.wanted))

        return Demand(child, is_wanted, lambda: not missing(child, children))

    def now_ns(self) -> int:
        """The system's time."""
        return self.keeper.now_ns() if self.keeper is not None else monotonic_ns()

    def beat(self) -> None:
        """Update our heartbeat, always in real time; end if we were stalled so long that our processes have ended."""
        now = monotonic_ns()
        passed_s, self._beat_ns = (now - self._beat_ns) * 1e-9 if self._beat_ns else 0.0, now
        lost_s = self.system.supervisor_lost_s * (1 if self.system.clock == WALL else SIMULATED_LOST)
        if passed_s > lost_s and not self.stopping:
            self.lost = True
            self.stopping = f"stalled for {passed_s:.1f} s; its processes have ended; start the system again"
        self.page.field("heartbeat_ns")[...] = now
        self._systemd.beat(now)

    def start_all(self) -> None:
        """Start all processes, each after those it needs; SetupFailed names one that did not start."""
        self.page.show("STARTING")
        if any(proc(row.kind).is_forked for row in self._rows):
            while not (self.stopping or self._template.has_imported()):
                self.let_time_pass()
                self.beat()
        for wave in waves(self._rows):
            children = [child for child in self.children if child.row in wave and child.row.start != ON_DEMAND]
            for child in children:
                if self.stopping:
                    return
                child.start()
                self.beat()
            self._awaited = [child for child in children if not proc(child.row.kind).declared]  # no user's process
            self._step_until(partial(_all_up, self._awaited, self.system.name), lambda: bool(self.stopping))
            if self.stopping:
                return
        self._awaited = []
        self.page.show("RUNNING")
        self._show()
        if self.keeper is not None and not self._awaits_holder:
            self.keeper.hold(False)
        self._systemd.tell("READY=1")
        if self.keeper is None:  # simulated time needs no rights
            shared = self._lock_shared()
            self.page.field("policy")[...] = in_words([*self._granted, shared])
            policies = {name: bytes(page.get("policy")).decode() for name, page in self._pages.items()}
            if rights := lacking(policies):
                log.warning("%s", rights)

    def _lock_shared(self) -> str:
        """Lock shared pages, with low priority: it takes 50 ms of a core, which may be the only one that io has."""
        step_back()
        try:
            return lock_shared(self.system.name, [child.process.pid for child in self.children], self.beat)
        finally:
            self._granted = realtime(self._row, self.system.clock)

    def _step_until(self, done: Callable[[], bool], end: Callable[[], bool]) -> None:
        while not done() and not end():
            self.step()

    def step(self) -> None:
        """One beat: handle commands, watch every process, judge those that run, let time pass."""
        self._commands()
        self._watch()
        self._judge()
        if self.page.state == "RUNNING" and not self.stopping:
            for demand in self._demands:
                demand.beat()
        self._show()  # before answers, so that clients find the new state
        self._requests.answer()
        self._clearings.beat(monotonic_ns())
        self._log_keeper.beat(monotonic_ns())
        self.let_time_pass()
        self.beat()

    def let_time_pass(self) -> None:
        """Wait one beat of real time; in simulated time, first admit the processes that run."""
        beat_s = BEAT_S if self.page.state == "RUNNING" else QUICK_BEAT_S
        if self.keeper is None:
            pause(beat_s)
            return
        if self._awaits_holder and self.page.state == "RUNNING" and self.keeper.holder.is_taken(0):
            self._awaits_holder = False
            self.keeper.hold(False)
        self.keeper.admit([child.row.name for child in self.children if child.process.ready])
        self.keeper.let_pass(beat_s)

    def run(self, seconds: float | None) -> None:
        """Watch the system until stopped, or for `seconds` of real time."""
        end = monotonic_ns() + round(seconds * 1e9) if seconds is not None else None
        while not self.stopping:
            self.step()
            if end is not None and monotonic_ns() >= end:
                self.stopping = f"{seconds:g} s are over"

    def _commands(self) -> None:
        for command in self.mailbox.drain():
            if command.name == "stop" and not command.text:
                self.stopping = self.stopping or "asked to stop"
                command.accept()
            elif self.stopping:
                command.refuse(f"the system is stopping: {self.stopping}")
            elif self.page.state == "STARTING" and command.name != "stop":
                command.refuse("the system is starting; ask again when it is up")
            else:
                self._requests.take(command)

    def _watch(self) -> None:
        reap_orphans([child.process.pid for child in self.children])
        for child in self.children:
            ending, name = child.look(), child.row.name
            if ending is not None:
                self._ended(child, ending)
            if not self.stopping and child.restart_when_due():
                self.events.status(f"{name} started again (pid {child.process.pid})", name)

    def _ended(self, child: Child, ending: Ending) -> None:
        name = child.row.name
        if not ending.asked and child in self._awaited:
            log.error("%s ended: %s; the system cannot start without it", name, child.reason)
        elif not ending.asked:
            begins = bool(child.restart_at_ns) and not self.stopping
            ended = child.shown_reason if begins else (
                f"{child.reason}; not restarted; when that is fixed: {verb_line(f'start {name}', self.system.name)}")
            text = f"{name} ended: {ended}"
            needs_none = REMEDY in text or not lifecycle.may_have_written(child.reason)
            self.events.report(codes.PROCESS_ENDED, text, name, has_remedy=needs_none)
        elif ending.killed:
            self.killed += 1
            text = "; ".join(filter(None, (f"{name} {ending.text}", proc(child.row.kind).on_kill)))
            self.events.report(codes.PROCESS_KILLED, text, name)
        else:
            log.info("%s ended: %s", name, ending.text)

    def _judge(self) -> None:
        """Report late processes, kill hung ones."""
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
                self.events.status(f"{name} resumes after {seconds:.2f} s", name)

    def _members(self) -> Iterator[JudgedProcess]:
        """All running processes, for the judge. In simulated time none is late, and a waiting one does not hang."""
        keeper = self.keeper
        for child in self.children:
            if not child.is_up or self.stopping or self.page.state != "RUNNING":
                continue
            name, row = child.row.name, child.row
            late_ns = math.inf if keeper is not None else late_s(row) * 1e9
            server = keeper.table.server if keeper is not None and name in keeper.table.asking else ""
            mark, hung_ns = int(self._pages[name].get("heartbeat_ns")), hung_s(row, simulated=keeper is not None) * 1e9
            yield JudgedProcess(name, mark, late_ns, hung_ns, server)

    def _show(self) -> None:
        """Publish the states of all processes after a change."""
        shown = [(child.shown_state, child.process.pid, child.restarts, child.shown_reason, child.is_up)
                 for child in self.children]
        if shown == self._shown:
            return
        self._shown = shown
        up = sum(child.is_up for child in self.children)
        self._systemd.tell(f"STATUS=system {self.system.name}: {up} of {len(self.children)} processes run")
        room = self._state.field("exit_reason").dtype.itemsize
        for i, child in enumerate(self.children):
            values = {"instance": child.row.name.encode(), "kind": child.row.kind.encode(),
                      "lifecycle": child.shown_state.encode(), "pid": child.process.pid, "restarts": child.restarts,
                      "exit_reason": shorten(child.shown_reason, room)}
            for name, value in values.items():
                self._state.field(name)[i] = value
        self._state.publish(self.now_ns())

    def stop_all(self) -> bool:
        """Stop in reverse order: ask, wait for `stop_s` of the kind, kill. True when none had to be killed."""
        self.page.show("STOPPING")
        self._systemd.tell("STOPPING=1")
        self.stopping = self.stopping or "its supervisor ends"
        self._requests.end(f"the system is stopping: {self.stopping}")
        for wave in reversed(waves(self._rows)):
            children = [child for child in self.children if child.row in wave]
            for child in children:
                child.stop()
            # A second request to stop shortens nothing: an io that is killed switches nothing off.
            self._step_until(partial(_all_ended, children), _all_killed(children))
        return not self.killed

    def close(self) -> None:
        """Remove all shared memory, then release addresses and the name."""
        memory.remove_all(self.system.name)
        self._template.close()
        self._held.close()
        self._systemd.close()


def _all_up(children: Sequence[Child], system: str) -> bool:
    for child in children:
        if child.state == lifecycle.STOPPED:
            name = child.row.name
            raise SetupFailed(f"{name}: {child.reason}; see {verb_line(f'logs {name}', system)}")
    return all(child.is_up for child in children)


def _all_killed(children: Sequence[Child]) -> Callable[[], bool]:
    """A test that becomes true GONE_S after the last pending kill."""
    last = monotonic_ns()

    def over() -> bool:
        nonlocal last
        now = monotonic_ns()
        if any(child.kill_at_ns for child in children):
            last = now
        return now >= last + round(GONE_S * 1e9)

    return over


def _all_ended(children: Sequence[Child]) -> bool:
    return all(child.state == lifecycle.STOPPED for child in children)
