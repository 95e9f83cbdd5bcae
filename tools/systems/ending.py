"""Verified end of a system: no process of it runs, none of its segments is in shared memory."""

from __future__ import annotations

from collections.abc import Callable

from trocar.shm.mailbox.client import MailboxFull
from trocar.shm.memory.parts import remove_all
from trocar.shm.memory.segment import SegmentError, held, names_of, path_of, segment_name
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.tools.client.remote import Remote
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import Say
from trocar.tools.systems.find import instances_of_kind, supervisor_of
from trocar.tools.systems.processes import CONTINUE, KILL, SUPERVISOR, TERMINATE, RunningProcess, running

POLL_S = 0.05
STOP_S = 45.0
ANSWER_NS = 3_000_000_000  # usually all is over by then; a signal does no harm to one that takes its time
ORPHAN_NS = 6_000_000_000  # longer than any process may take to end


def stop_system(system: str, say: Say, timeout: float = STOP_S, keep: Callable[[str], object] = str) -> int:
    """End a system; returns how many segments were left for us to remove. Problem names the remains after `timeout` s.

    `keep` is called once if it has no supervisor (any more), before its memory changes or is removed. The supervisor
    gets a stop by mailbox; if that is unavailable or has no effect, SIGTERM. Without a supervisor its processes, which
    should end by themselves, get SIGTERM, and are killed if they do not end.
    """
    ending, end = _Ending(system, keep), monotonic_ns() + round(timeout * 1e9)
    while left := ending.step(monotonic_ns()):
        if monotonic_ns() >= end:
            raise Problem(f"system {system} is not down after {timeout:g} s: {left}")
        say(f"stopping {system}", None)
        pause(POLL_S)
    return ending.cleared


class _Ending:
    """Successive looks at the remains of a system."""

    def __init__(self, system: str, keep: Callable[[str], object]) -> None:
        self.system, self.cleared = system, 0
        self._keep, self._is_kept = keep, False
        supervisor = supervisor_of(system)
        self._first = supervisor.pid if supervisor is not None else 0
        self._signal_at_ns = monotonic_ns() + ANSWER_NS if supervisor is not None and self._ask() else 0
        self._kill_at_ns = 0
        self._sent: set[tuple[RunningProcess, int]] = set()

    def _ask(self) -> bool:
        try:
            with Remote(self.system, SUPERVISOR) as remote:
                remote.send("stop")
        except (SegmentError, MailboxFull):
            return False
        return True

    def step(self, now_ns: int) -> str:
        """Take the next step; returns the remains, in words, empty if there are none."""
        supervisor, processes = supervisor_of(self.system), running(self.system)
        if supervisor is not None:
            if supervisor.pid != self._first:
                raise Problem(f"system {self.system} was started again meanwhile (supervisor pid {supervisor.pid})")
            if now_ns >= self._signal_at_ns:
                self._send([each for each in processes if each.pid == supervisor.pid], TERMINATE)
            return self._left(processes) or f"{SUPERVISOR} (pid {supervisor.pid})"
        if not self._is_kept:
            self._is_kept = True
            self._keep(self.system)
        if processes or self._holders():
            self._kill_at_ns = self._kill_at_ns or now_ns + ORPHAN_NS
            self._send(processes, TERMINATE if now_ns < self._kill_at_ns else KILL)
            return self._left(processes)
        self.cleared += remove_all(self.system)
        return self._left([])

    def _send(self, processes: list[RunningProcess], number: int) -> None:
        """Send a signal, once to each; a stopped process is woken."""
        for process in processes:
            if (process, number) not in self._sent:
                self._sent.add((process, number))
                process.send(number)
                process.send(CONTINUE)

    def _holders(self) -> list[str]:
        """Control pages that processes hold which we cannot see, as in another container; a user's programs may."""
        others = instances_of_kind(self.system, "third_party")
        pages = [segment_name(*parts) for parts in names_of(self.system) if parts[2] == "control"
                 and parts[1] not in others]
        return [f"the holder of {path_of(page)} (fuser -v)" for page in pages if held(page)]

    def _left(self, processes: list[RunningProcess]) -> str:
        segments = len(names_of(self.system))
        parts = [*map(str, processes), *([] if processes else self._holders())]
        return ", ".join(parts + ([f"{segments} segments in shared memory"] if segments else []))
