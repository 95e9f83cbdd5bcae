"""The life of one instance: what was asked of it, what became of it, and when it is started again.

Pure: it acts on a process that it is given and reads a clock that it is given. The states are those of
procs/tables/lifecycle.py; each way in (`start`, `stop`, `look`) is one event of that table. And who is wanted, and who
needs whom: the order in which the processes of a system start; they stop in reverse.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from trocar.procs.document.system import Process
from trocar.procs.node.setup_error import STAYS
from trocar.procs.supervisor.os_process import OsProcess
from trocar.procs.tables import lifecycle
from trocar.procs.tables.manifest import proc
from trocar.shm.time.clock import monotonic_ns

HEALTHY_NS: Final = 10_000_000_000
SETUP_S: Final = 60.0
SETTLES_S: Final = 0.3  # so long after its setup, and a period, a user's process has shown that it runs
GIVEN_UP: Final = "; given up after "
TRACE_S: Final = 1.0  # how long a user's process may take to write where it hangs, and to end
SHORT_TRACE_S: Final = 0.03  # any other: what it holds waits for its successor


@dataclass(frozen=True, slots=True)
class Ending:
    """The end of one process: how, in words; whether it was asked for, or killed because it took too long.

    Who ends well while nobody wants it was not asked, but meant to.
    """

    text: str
    asked: bool
    killed: bool


@dataclass(slots=True)
class Child:
    """One instance as the supervisor sees it; all times are real, monotonic ns, whatever clock the system has."""

    row: Process
    process: OsProcess
    now_ns: Callable[[], int] = monotonic_ns
    state: str = lifecycle.STOPPED
    starts: int = 0  # how many processes it has had: the number of the one that runs
    restarts: int = 0  # of them by the policy for deaths
    failures: int = 0  # deaths without a healthy while in between
    reason: str = ""  # how the last one ended
    begun_ns: int = 0
    restart_at_ns: int = 0  # 0: no restart planned
    up_ns: int = 0  # since when its setup has succeeded
    kill_at_ns: int = 0  # 0: nobody waits for its end, nor for its setup
    given_up: bool = False
    verdict: str = ""  # why we killed it
    refused: str = ""  # why there is no process where there should be one
    is_wanted: bool = True  # if not, it may end by itself: that is no death
    is_done: bool = False  # it has done so

    @property
    def is_up(self) -> bool:
        """It runs, its setup has succeeded, and nobody has asked it to end."""
        return self.state == lifecycle.RUNNING and self.process.ready

    @property
    def has_begun(self) -> bool:
        """It is up; a user's has also got through its first period."""
        settles_s = self.row.period_s + SETTLES_S if proc(self.row.kind).declared else 0.0
        return self.is_up and not self.kill_at_ns and self.now_ns() >= self.up_ns + round(settles_s * 1e9)

    @property
    def shown_state(self) -> str:
        """Its state for others: one that ended by itself and is to begin again is restarting."""
        return lifecycle.RESTARTING if self.state == lifecycle.STOPPED and self.restart_at_ns else self.state

    @property
    def is_down(self) -> bool:
        """There is no process, and nobody is going to start one."""
        return self.state == lifecycle.STOPPED and not self.restart_at_ns

    def start(self) -> None:
        """A process is wanted: it begins now, or when the one before has ended, or it runs already."""
        if self.given_up:
            self.reason = self.reason.partition(GIVEN_UP)[0]
        self._step_by_hand(lifecycle.START)

    def stop(self) -> None:
        """No process is wanted; one that has ended by itself is shown as stopped from now on."""
        self._step_by_hand(lifecycle.STOP)
        if self.state == lifecycle.STOPPED and self.starts:
            self.process.show_stopped()

    def stop_what_ended(self) -> None:
        """An operator wants none, and it has ended before: that is no problem any more, also where it has failed."""
        self.stop()
        if self.starts:
            self.process.show_stopped(also_failed=True)
            if not lifecycle.is_meant(self.reason):
                self.reason = f"{lifecycle.ASKED}: it had ended before: {self.reason}"

    def kill_hung(self, silent_s: float) -> None:
        """It lives, but does not go on: kill it; the policy for deaths decides about the next one."""
        self._kill(f"hung for {silent_s:.1f} s, killed")

    def look(self) -> Ending | None:
        """What became of it: how it ended, if it has. Kills who takes too long to begin or to end."""
        if self.kill_at_ns and self.state == lifecycle.RUNNING and self.process.ready and not self.verdict:
            self.kill_at_ns, self.up_ns = 0, self.now_ns()  # its setup has succeeded
        if self.kill_at_ns and self.now_ns() >= self.kill_at_ns:
            begins = self.state == lifecycle.RUNNING
            self._kill(f"setup was not done within {SETUP_S:.0f} s, killed" if begins else
                       f"did not end within {proc(self.row.kind).stop_s:g} s, killed")
        code = self.process.ended()
        return None if code is None and not self.refused else self._ended(code)

    def restart_when_due(self) -> bool:
        """Carry out a planned restart; True when a process was started."""
        if not self.restart_at_ns or self.now_ns() < self.restart_at_ns:
            return False
        self.restart_at_ns, self.restarts = 0, self.restarts + 1
        self._step(lifecycle.START)
        return True

    def _step_by_hand(self, event: str) -> None:
        """What is asked for comes before what the policy for deaths has planned; it begins anew."""
        self.restart_at_ns, self.failures, self.given_up = 0, 0, False
        self._step(event)

    def _step(self, event: str) -> None:
        self.state, done = lifecycle.step(self.state, event)
        if done == lifecycle.BEGIN:
            self._begin()
        elif done == lifecycle.ASK:
            self.kill_at_ns = self.now_ns() + round(proc(self.row.kind).stop_s * 1e9)
            self.process.ask_to_end()

    def _begin(self) -> None:
        self.starts, self.begun_ns, self.is_done = self.starts + 1, self.now_ns(), False
        self.kill_at_ns = self.begun_ns + round(SETUP_S * 1e9)
        try:
            self.process.begin()
        except OSError as error:
            self.refused = f"could not be started: {error}"

    def _kill(self, verdict: str) -> None:
        """It gets a short time to write where it hangs; the second time it is killed."""
        if self.verdict:
            self.kill_at_ns = 0
            self.process.kill()
            return
        is_users = proc(self.row.kind).declared
        self.verdict = verdict
        self.kill_at_ns = self.now_ns() + round((TRACE_S if is_users else SHORT_TRACE_S) * 1e9)
        if is_users:
            self.process.abort()
        else:
            self.process.trace()

    def _ended(self, code: int | None) -> Ending:
        asked, why = self.state != lifecycle.RUNNING, self.refused or self.verdict
        well = asked and code in (0, -signal.SIGTERM)  # by the signal: it had not come so far as to hear it
        self.is_done = not asked and not why and code == 0 and not self.is_wanted
        why = why or self.process.in_words(code or 0)
        if well or self.is_done:
            self.reason = lifecycle.ASKED if well else lifecycle.DONE
        else:
            self.reason = f"{lifecycle.ASKED}: {why}" if asked else why
        if self.verdict and not well and (where := self.process.where()):
            self.reason += f"; where: {where}, trocar logs {self.row.name}"
        killed = bool(self.verdict) and not well
        if asked:
            self.process.show_stopped()
        self.kill_at_ns, self.verdict, self.refused = 0, "", ""
        self._step(lifecycle.QUIT)
        if not asked and not self.is_done:
            self._plan_restart(code)
        return Ending(self.reason, asked or self.is_done, killed)

    def _plan_restart(self, code: int | None) -> None:
        now = self.now_ns()
        self.failures = 1 if now - self.begun_ns > HEALTHY_NS else self.failures + 1
        if self.row.on_exit != "restart" or not proc(self.row.kind).restart:
            return
        if code == STAYS:
            self.given_up = True
            return
        if self.failures > self.row.restart_limit:
            self.given_up = True
            self.reason += f"{GIVEN_UP}{self.row.restart_limit} restarts"
            return
        wait_s = self.row.backoff_s * 2 ** (self.failures - 1)
        self.restart_at_ns = now + round(wait_s * 1e9)


class Demand:
    """What clients want of one instance on demand: the first starts it, after the last one left it stops.

    What a person has asked for by hand stands: one that was stopped while somebody wants it is started again when
    somebody wants it anew, one that was started while nobody does runs until somebody has wanted it, or it is stopped.
    One that ends by itself while nobody wants it may do so.
    """

    def __init__(self, child: Child, is_wanted: Callable[[bool, bool], bool], is_possible: Callable[[], bool]) -> None:
        """`is_possible`: all that it needs is there.

        `is_wanted` is told whether it is refused to all who want it, and whether it would stop now for want of them:
        then the answer is of this moment.
        """
        self._child, self._is_wanted, self._is_possible = child, is_wanted, is_possible
        self._is_served, self._left_ns = False, 0
        self._is_lingering = False  # it was up when the last one left

    def beat(self) -> None:
        """Start it, or stop it, as is wanted now."""
        child = self._child
        is_ending = child.is_down or child.state == lifecycle.STOPPING
        if child.is_done or (self._is_lingering and is_ending):  # it ended, or was stopped, while nobody wanted it
            self._is_served = False
        child.is_wanted = self._is_wanted(self._is_served and child.is_down, False)
        if child.is_wanted:
            self._left_ns, self._is_lingering = 0, False
            if not self._is_served and self._is_possible():
                self._is_served = True
                child.start()
        elif self._is_served:
            now = child.now_ns()
            if not self._left_ns:
                self._left_ns, self._is_lingering = now, not is_ending
            if now - self._left_ns >= child.row.linger_s * 1e9 and not self._is_wanted(False, True):
                self._is_served = self._is_lingering = False
                child.stop()


class Circle(ValueError):
    """Some wait for each other; the message names them."""


def waves(rows: Sequence[Process]) -> list[list[Process]]:
    """Rows in start order: each wave needs only instances of earlier ones. Circle when there is none."""
    found: list[list[Process]] = []
    left, up = list(rows), set[str]()
    known = {row.name for row in rows}
    while left:
        wave = [row for row in left if all(name in up or name not in known for name in row.after)]
        if not wave:
            raise Circle(f"{', '.join(row.name for row in left)}: each waits for another to start first")
        found.append(wave)
        up |= {row.name for row in wave}
        left = [row for row in left if row.name not in up]
    return found


def missing(child: Child, children: Mapping[str, Child]) -> list[str]:
    """What an instance needs and nobody is going to start; one that runs goes on without."""
    if child.state != lifecycle.STOPPED:
        return []
    return [name for name in child.row.after if name in children and children[name].is_down]
