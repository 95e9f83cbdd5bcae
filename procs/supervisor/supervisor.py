"""One running system: its shared memory, its processes from start to stop, requests about them, silent processes."""

from __future__ import annotations

import logging
import math
import os
import socket
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing
from typing import Final

from trocar.procs.document.process import ELSEWHERE, ON_DEMAND
from trocar.procs.document.system import WALL, Process, SystemConfig
from trocar.procs.machine.log_files import put_run_aside
from trocar.procs.machine.paths import made_log_folder, made_recordings_folder
from trocar.procs.machine.verb_lines import REMEDY, verb_line
from trocar.procs.node.realtime import in_words, lacking, realtime, step_back
from trocar.procs.node.setup_error import SetupError
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
from trocar.procs.tables.manifest import ROBOTS, hung_s, lost_s, proc, silence_s
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.audit import Audit
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.memory.layout import shorten
from trocar.shm.memory.parts import in_words as removed_in_words
from trocar.shm.memory.parts import remove_all
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
LOOK_NS: Final = 1_000_000_000
log = logging.getLogger("supervisor")


def highest_priority(rows: Sequence[Process]) -> int:
    """The supervisor's priority: the highest of all processes that drive robots, so that it can kill one that hangs.

    Not that of emulated boards, which is above io's: each of our beats would stall io for a large part of its period.
    """
    return max((row.priority for row in rows if proc(row.kind).priority in ROBOTS), default=0)


class Supervisor:
    """One running system."""

    def __init__(self, system: SystemConfig, awaits_holder: bool = False, template: Template | None = None) -> None:
        """Make all shared memory; SegmentError when the name is taken or memory is full, SetupError.

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
            lock = held.enter_context(memory.hold_name(system.name))
            put_run_aside(self._folder, system.logs.keep)
            held.enter_context(gui_token(system))
            self._listening = {row.name: held.enter_context(closing(Listening(row))) for row in system.processes}
            self._make(memory.maker(system.group), lock)
            held.enter_context(self._segments)
            self._log_keeper = held.enter_context(closing(LogKeeper(self._folder, system.logs)))
            self._held = held.pop_all()  # until here `close` cannot be called

    def _make(self, make: Make, lock: socket.socket) -> None:
        system = self.system
        left = memory.clear_left_over(system.name)
        if left:
            log.warning("removed %d segments that a crashed system left", left)
        self.system = system = memory.fitted(system)
        if system.shortage:
            log.warning("%s", system.shortage)
        with memory.whole_or_none(system):
            self.size = memory.create_rest(system, make)
            self._begin(make)
            self.size += memory.publish(system, make)
            self._template.prepare(system.name)
            self._segments = memory.kept(system, lock)

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
        self._waves = [[child for child in self.children if child.row in wave] for wave in waves(self._rows)]
        self._wave = 0  # the one that starts
        self._demands = [self._demand(child) for child in self.children if child.row.start == ON_DEMAND]
        self._requests, self._clearings = Requests(self.children), Clearings(system)
        self._shown: list[tuple[str, int, int, str, bool]] = []
        self._look_at_ns = self._removed = 0
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
        if passed_s > lost_s(self.system, simulated=self.system.clock != WALL) and not self.stopping:
            self.lost = True
            self.stopping = f"stalled for {passed_s:.1f} s; its processes have ended; start the system again"
        self.page.field("heartbeat_ns")[...] = now
        self._systemd.beat(now)

    def start_all(self) -> None:
        """Start all processes, each after those it needs; SetupError names one that did not start."""
        self.page.show("STARTING")
        if any(proc(row.kind).is_forked for row in self._rows):
            while not (self.stopping or self._template.has_imported()):
                self.let_time_pass()
                self.beat()
        while not (self.stopping or self.step()):
            pass
        if self.stopping:
            return
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

    def step(self) -> bool:
        """One beat: decide which processes should run, compare them with those that do, and let time pass.

        Returns whether everything is in place: all are up, or, if we are `stopping`, all have ended.
        """
        self._take_commands()
        self._look()
        self._judge()
        is_reached = self._set_targets()
        self._ensure()
        self._show()  # before answers, so that clients find the new state
        self._requests.answer()
        self._clearings.beat(monotonic_ns())
        self._log_keeper.beat(monotonic_ns())
        self._look_for_removed(monotonic_ns())
        self.let_time_pass()
        self.beat()
        return is_reached

    def _set_targets(self) -> bool:
        """Which processes should run: wave by wave at the start and, in reverse, at the end; meanwhile by demand."""
        if self.stopping:
            for wave in reversed(self._waves):
                for child in wave:
                    child.stop()
                if not all(child.is_gone for child in wave):
                    return False
        elif self.page.state == "RUNNING":
            for demand in self._demands:
                demand.beat()
        else:
            while self._wave < len(self._waves):
                for child in self._waves[self._wave]:
                    if child.row.start != ON_DEMAND and not child.starts:
                        child.start()
                if not _all_up(self._awaited(), self.system.name):
                    return False
                self._wave += 1
        return True

    def _awaited(self) -> list[Child]:
        """The processes that must come up now, or the start fails: no user's process."""
        wave = self._waves[self._wave] if self.page.state == "STARTING" and self._wave < len(self._waves) else []
        return [child for child in wave if child.row.start != ON_DEMAND and not proc(child.row.kind).declared]

    def _ensure(self) -> None:
        for child in self.children:
            starts = child.starts
            if child.ensure(may_begin=not self.stopping):
                self.events.status(f"{child.row.name} started again (pid {child.process.pid})", child.row.name)
            if child.starts != starts:
                self.beat()  # the fork has taken a while

    def let_time_pass(self) -> None:
        """Wait one beat of real time; in simulated time, first admit the processes that run."""
        self._segments.beat()
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
                self.stopping = f"the time limit of {seconds:g} s has passed"

    def _take_commands(self) -> None:
        for command in self.mailbox.drain():
            if command.name == "stop" and not command.text:
                self.stopping = self.stopping or "asked to stop"
                command.accept()
            elif self.stopping:
                command.refuse(f"the system is stopping: {self.stopping}")
            elif self.page.state == "STARTING" and command.name != "stop":
                command.refuse("the system is starting; try again when it is up")
            else:
                self._requests.take(command)
        if self.stopping:
            self._requests.end(f"the system is stopping: {self.stopping}")

    def _look(self) -> None:
        reap_orphans([child.process.pid for child in self.children])
        for child in self.children:
            if (ending := child.look()) is not None:
                self._ended(child, ending)

    def _ended(self, child: Child, ending: Ending) -> None:
        name = child.row.name
        if not ending.asked and child in self._awaited():
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
            name, seconds, allowed_s = verdict.name, verdict.silent_s, silence_s(child.row)
            if verdict.what == LATE:
                text = f"{name} is late: silent for {seconds:.2f} s; allowed: {allowed_s:g} s"
                self.events.report(codes.PROCESS_LATE, text, name, value=seconds, limit=allowed_s)
            elif verdict.what == HUNG:
                log.error("%s hangs: silent for %.2f s; killing it", name, seconds)
                child.kill_hung(seconds)
                if self.keeper is not None and name == self.keeper.table.server:
                    self.judge.forget(self.keeper.table.asking)
            else:
                self.events.status(f"{name} resumes after {seconds:.2f} s", name)

    def _look_for_removed(self, now_ns: int) -> None:
        """Report segments whose names another program has removed; our processes have them mapped."""
        if now_ns < self._look_at_ns:
            return
        self._look_at_ns = now_ns + LOOK_NS
        removed = self._segments.removed()
        if len(removed) > self._removed:
            names = [name.split("~", 2)[2] for name in removed]
            self.events.report(codes.MEMORY_REMOVED, removed_in_words(names, self._segments.count))
        self._removed = len(removed)

    def _members(self) -> Iterator[JudgedProcess]:
        """All running processes, for the judge. In simulated time none is late, and a waiting one does not hang."""
        keeper = self.keeper
        for child in self.children:
            if not child.is_up or self.stopping or self.page.state != "RUNNING":
                continue
            name, row = child.row.name, child.row
            late_ns = math.inf if keeper is not None else silence_s(row) * 1e9
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
        self.stopping = self.stopping or "its supervisor is exiting"
        while not self.step():  # a second request shortens nothing: an io that is killed switches nothing off
            pass
        return not self.killed

    def close(self) -> None:
        """Remove all shared memory, then release addresses and the name."""
        self._segments.close()  # first, so that what we remove does not look as if another program did
        remove_all(self.system.name)
        self._template.close()
        self._held.close()
        self._systemd.close()


def _all_up(children: Sequence[Child], system: str) -> bool:
    for child in children:
        if child.starts and not child.runs:
            name = child.row.name
            raise SetupError(f"{name}: {child.reason}; see {verb_line(f'logs {name}', system)}")
    return all(child.is_up for child in children)
