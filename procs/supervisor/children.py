"""The lifecycle of one instance: requests, endings and restarts; also demand, and the order of start and stop.

The processes of an instance are numbered. `start`, `stop` and the restart policy decide which one should run, the
`target`; `look` finds out what runs, and `ensure` makes one of the other. Process and clock are passed in. Processes
start in the order of their dependencies, and stop in reverse order.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from trocar.procs.document.system import Process
from trocar.procs.node.setup_error import STAYS, SetupError
from trocar.procs.supervisor.os_process import OsProcess
from trocar.procs.tables import lifecycle
from trocar.procs.tables.manifest import proc
from trocar.shm.time.clock import monotonic_ns

HEALTHY_NS: Final = 10_000_000_000
SETUP_S: Final = 60.0
SETTLES_S: Final = 0.3  # after its setup, plus a period: then a user's process counts as running
GIVEN_UP: Final = "; given up after "
TRACE_S: Final = 1.0  # time for a user's process to write the trace of a hang, and to end
SHORT_TRACE_S: Final = 0.03  # for all others, whose restart is urgent
GONE_S: Final = 5.0  # the longest that a killed process takes to be gone


@dataclass(frozen=True, slots=True)
class Ending:
    """The end of one process: why it ended, whether that was requested, and whether it was killed for taking too long.

    `asked` is also true for an on-demand process that ended without error while it had no clients.
    """

    text: str
    asked: bool
    killed: bool


@dataclass(slots=True)
class Child:
    """One instance as seen by the supervisor; all times are real (monotonic ns), also in simulated time."""

    row: Process
    process: OsProcess
    now_ns: Callable[[], int] = monotonic_ns
    target: int = 0
    """Number of the process that should run; 0: none."""
    starts: int = 0
    """Count of its processes: the number of the present, or last, one."""
    runs: bool = False
    """Whether there is a process, as far as we have looked."""
    restarts: int = 0  # starts by the restart policy
    failures: int = 0  # crashes with less than HEALTHY_NS in between
    reason: str = ""  # how the last process ended
    begun_ns: int = 0
    restart_at_ns: int = 0  # when the restart policy starts it; 0: that is not planned
    up_ns: int = 0  # when its setup succeeded
    kill_at_ns: int = 0  # deadline of its setup or end; 0: none
    killed_ns: int = 0  # when it was killed; 0: it was not
    is_asked: bool = False  # the present process was asked to end
    given_up: bool = False
    verdict: str = ""  # why we killed it
    refused: str = ""  # why its process could not be started
    is_wanted: bool = True  # if not, it may end by itself without a restart
    is_done: bool = False  # it has ended in that way

    @property
    def state(self) -> str:
        """What runs, and what should: see procs/tables/lifecycle.py."""
        if not self.runs:
            return lifecycle.STOPPED
        if self.target == self.starts:
            return lifecycle.RUNNING
        return lifecycle.RESTARTING if self.target else lifecycle.STOPPING

    @property
    def is_up(self) -> bool:
        """Whether it runs, its setup has succeeded, and it was not asked to end."""
        return self.state == lifecycle.RUNNING and self.process.ready

    @property
    def has_begun(self) -> bool:
        """Whether it is up; a user's process must also have run for a period plus SETTLES_S."""
        settles_s = self.row.period_s + SETTLES_S if proc(self.row.kind).declared else 0.0
        return self.is_up and not self.kill_at_ns and self.now_ns() >= self.up_ns + round(settles_s * 1e9)

    @property
    def shown_state(self) -> str:
        """Its state for display: an ended instance with a planned restart is RESTARTING."""
        return lifecycle.RESTARTING if self.restart_at_ns else self.state

    @property
    def shown_reason(self) -> str:
        """How its last process ended, for display, with the number of the automatic restart that follows, or followed.
        """
        again = f"; automatic restart {self.failures} of {self.row.restart_limit}"
        return self.reason + (again if self.failures and not self.given_up else "")

    @property
    def is_down(self) -> bool:
        """Whether no process runs, or should."""
        return not (self.runs or self.target)

    @property
    def is_gone(self) -> bool:
        """Whether it has ended, or was killed so long ago that there is no hope that it ends."""
        return not self.runs or 0 < self.killed_ns <= self.now_ns() - round(GONE_S * 1e9)

    def start(self) -> None:
        """A process should run: the present one, unless it was asked to end, else a new one."""
        if self.given_up:
            self.reason = self.reason.partition(GIVEN_UP)[0]
        self._forget_failures()
        if self.state != lifecycle.RUNNING:
            self.target = self.starts + 1

    def stop(self) -> None:
        """No process should run; one that has ended by itself is shown as stopped from now on."""
        self._forget_failures()
        self.target = 0
        if not self.runs and self.starts:
            self.process.show_stopped()

    def stop_what_ended(self) -> None:
        """Stop on an operator's request after it has ended: its failure is no longer shown as a problem."""
        self.stop()
        if self.starts:
            self.process.show_stopped(also_failed=True)
            if not lifecycle.is_meant(self.reason):
                self.reason = f"{lifecycle.ASKED}: it had ended before: {self.reason}"

    def kill_hung(self, silent_s: float) -> None:
        """Kill a process that hangs; the restart policy decides about the next one."""
        self._kill(f"hung for {silent_s:.1f} s, killed")

    def look(self) -> Ending | None:
        """Check the process; returns its ending, if any. Kills one that takes too long to begin or to end."""
        if self.kill_at_ns and self.state == lifecycle.RUNNING and self.process.ready and not self.verdict:
            self.kill_at_ns, self.up_ns = 0, self.now_ns()  # its setup has succeeded
        if self.kill_at_ns and self.now_ns() >= self.kill_at_ns:
            begins = self.state == lifecycle.RUNNING
            self._kill(f"setup was not done within {SETUP_S:.0f} s, killed" if begins else
                       f"did not end within {proc(self.row.kind).stop_s:g} s, killed")
        code = self.process.ended()
        return None if code is None and not self.refused else self._ended(code)

    def ensure(self, may_begin: bool = True) -> bool:
        """Begin the process that should run, or ask one that should not to end. True when the restart policy began it.
        """
        now = self.now_ns()
        if self.runs:
            if self.target != self.starts and not self.is_asked:
                self.is_asked, self.kill_at_ns = True, now + round(proc(self.row.kind).stop_s * 1e9)
                self.process.ask_to_end()
            return False
        if not (self.target and may_begin and now >= self.restart_at_ns):
            return False
        is_restart, self.restart_at_ns = bool(self.restart_at_ns), 0
        self.restarts += is_restart
        self.starts, self.begun_ns, self.runs = self.target, now, True
        self.is_done, self.is_asked, self.killed_ns = False, False, 0
        self.kill_at_ns = now + round(SETUP_S * 1e9)
        try:
            self.process.begin()
        except OSError as error:
            self.refused = f"could not be started: {error}"
        return is_restart

    def _forget_failures(self) -> None:
        """A request by hand cancels a planned restart and resets the restart policy."""
        self.restart_at_ns, self.failures, self.given_up = 0, 0, False

    def _kill(self, verdict: str) -> None:
        """Request a trace of the hang first; kill it at the second call, or at once if it is stopped (SIGSTOP)."""
        is_stopped = not self.verdict and self.process.is_stopped
        if self.verdict or is_stopped:
            self.verdict = self.verdict or f"{verdict}; it was stopped (SIGSTOP)"
            self.kill_at_ns, self.killed_ns = 0, self.now_ns()
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
        well = asked and code in (0, -signal.SIGTERM)  # by the signal: it ended before its handler was installed
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
        self.kill_at_ns, self.verdict, self.refused, self.runs = 0, "", "", False
        if not asked:
            self.target = 0
            if not self.is_done:
                self._plan_restart(code)
        return Ending(self.reason, asked or self.is_done, killed)

    def _plan_restart(self, code: int | None) -> None:
        now = self.now_ns()
        if self.row.on_exit != "restart" or not proc(self.row.kind).restart:
            return
        self.failures = 1 if now - self.begun_ns > HEALTHY_NS else self.failures + 1
        if code == STAYS:
            self.given_up = True
            return
        if self.failures > self.row.restart_limit:
            self.given_up = True
            self.reason += f"{GIVEN_UP}{self.row.restart_limit} restarts"
            return
        wait_s = self.row.backoff_s * 2 ** (self.failures - 1)
        self.restart_at_ns, self.target = now + round(wait_s * 1e9), self.starts + 1


class Demand:
    """Clients' demand for one instance: the first client starts it; after the last one has left, it stops.

    Start and stop by hand stay in force: an instance stopped by hand while it has clients starts again only at a new
    demand; one started by hand without clients runs until clients have come and left, or it is stopped. Without
    clients it may also end by itself.
    """

    def __init__(self, child: Child, is_wanted: Callable[[bool, bool], bool], is_possible: Callable[[], bool]) -> None:
        """`is_possible`: whether all instances that it needs are there.

        `is_wanted` has two parameters: whether clients are to be refused, and whether the instance would stop now if
        it has none, which needs an up-to-date answer.
        """
        self._child, self._is_wanted, self._is_possible = child, is_wanted, is_possible
        self._is_served, self._left_ns = False, 0
        self._is_lingering = False  # it was up when the last client left

    def beat(self) -> None:
        """Start or stop it according to the present demand."""
        child = self._child
        is_ending = child.is_down or child.state == lifecycle.STOPPING
        if child.is_done or (self._is_lingering and is_ending):  # it ended, or was stopped, without clients
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


def waves(rows: Sequence[Process]) -> list[list[Process]]:
    """Rows in start order: each wave needs only instances of earlier waves. SetupError when there is no such order."""
    found: list[list[Process]] = []
    left, up = list(rows), set[str]()
    known = {row.name for row in rows}
    while left:
        wave = [row for row in left if all(name in up or name not in known for name in row.after)]
        if not wave:
            raise SetupError(f"{', '.join(row.name for row in left)}: each waits for another to start first")
        found.append(wave)
        up |= {row.name for row in wave}
        left = [row for row in left if row.name not in up]
    return found


def missing(child: Child, children: Mapping[str, Child]) -> list[str]:
    """Instances that a stopped one needs and that are down; a running one continues without them."""
    return [] if child.runs else [name for name in child.row.after if name in children and children[name].is_down]
