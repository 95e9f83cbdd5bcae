"""Starting a supervisor from outside: a module for the command line, not an import."""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from trocar.procs.machine.log_files import put_aside
from trocar.procs.machine.open_files import shortage
from trocar.procs.machine.paths import made_log_folder
from trocar.procs.machine.verb_lines import verb_line
from trocar.shm.memory.segment import SegmentError, names_of
from trocar.shm.time.clock import monotonic_ns, pause
from trocar.shm.time.control_page import ControlPage
from trocar.tools.output.errors import Problem
from trocar.tools.output.printing import Say, progress
from trocar.tools.systems.cleanup import Keeper
from trocar.tools.systems.ending import POLL_S, STOP_S, stop_system
from trocar.tools.systems.find import environment, forbidden, is_up, other_owner
from trocar.tools.systems.processes import running
from trocar.tools.verbs.logs import tail

MODULE = "trocar.procs.supervisor.loop"
PR_SET_PDEATHSIG, TERMINATE = 1, 15
ROOM = 160  # bytes for the command lines of processes, with two names, beyond those of the shortest supervisor's
LIBC = ctypes.CDLL(None)
START_S = 300.0  # a supervisor that cannot start ends at once with the reason; a busy machine is slow


@dataclass(frozen=True, slots=True)
class StartRequest:
    """Start options of a system."""

    file: Path
    system: str
    boards: str = ""
    paths: tuple[Path, ...] = ()
    sets: tuple[str, ...] = ()
    seconds: float | None = None
    document: bool = False
    """The file is a frozen document, as recordings have it."""
    held: bool = False
    """Simulated time stays at its beginning until a program holds it back (shm/time/held_time.py)."""

    def command(self) -> list[str]:
        """The supervisor's command line."""
        # -P: modules are ours, whatever is in the caller's working folder
        words = [sys.executable, "-P", "-m", MODULE, str(self.file), "--system", self.system]
        words += ["--boards", self.boards] if self.boards else []
        for path in self.paths:
            words += ["--path", str(path)]
        for each in self.sets:
            words += ["--set", each]
        words += ["--document"] if self.document else []
        words += ["--held"] if self.held else []
        words += ["--for", f"{self.seconds:g}"] if self.seconds is not None else []
        return [*words, "--room", " " * ROOM]


def refuse_taken(system: str) -> None:
    """Problem if a system of this name is up, or is another user's."""
    if forbidden(system):
        raise Problem(f"not permitted: system {system} belongs to {other_owner(system)}; --system gives another name")
    if is_up(system):
        raise Problem(f"system {system} is up already; {verb_line('down', system)} stops it, --system gives another "
                      "name")
    if not names_of(system) and (left := [f"{each.instance} (pid {each.pid})" for each in running(system)]):
        raise Problem(f"processes of an earlier system {system} still run, and their memory was removed: "
                      f"{', '.join(left)}; {verb_line('down', system)} ends them")


def refuse_shortage() -> None:
    """Problem if a system could not open its files: a supervisor can only raise the soft limit."""
    wrong, mend = shortage(*resource.getrlimit(resource.RLIMIT_NOFILE))
    if wrong:
        raise Problem(f"{wrong}; first: {mend}")


def _end_with_parent() -> None:
    """In the child, before it becomes the supervisor: the kernel sends it SIGTERM when our process ends."""
    LIBC.prctl(PR_SET_PDEATHSIG, TERMINATE, 0, 0, 0)


class Background:
    """A supervisor in a session of its own, its output in its log file."""

    def __init__(self, request: StartRequest, *, tied: bool = False) -> None:
        """Start it; returns at once. `tied`: at any end of ours, it ends and is removed completely."""
        refuse_shortage()
        refuse_taken(request.system)
        self.system = request.system
        self.log = made_log_folder(os.environ, request.system) / "supervisor.log"
        put_aside(self.log)
        with self.log.open("ab") as log:  # it may be emptied under the supervisor
            self.popen = subprocess.Popen(request.command(), stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                                          env={**environment(), "PYTHONIOENCODING": "utf-8"}, start_new_session=True,
                                          preexec_fn=_end_with_parent if tied else None)
        self._keeper = Keeper(request.system) if tied else None

    def wait_until_up(self, say: Say, timeout: float = START_S) -> None:
        """Wait until every process is up; Problem carries the supervisor's message if they are not."""
        end = monotonic_ns() + round(timeout * 1e9)
        while (shown := self.state()) != "RUNNING":
            if self.popen.poll() is not None:
                raise Problem(f"system {self.system} did not come up:\n{tail(self.log, 30)}")
            if monotonic_ns() >= end:
                raise Problem(f"system {self.system} is not up after {timeout:g} s ({shown or 'no shared memory'})")
            say(f"starting {self.system}", None)
            pause(POLL_S)

    def state(self) -> str:
        """The state our supervisor shows; empty before it has shared memory."""
        try:
            page = ControlPage(self.system, "supervisor")
        except SegmentError:
            return ""
        with contextlib.closing(page):
            return page.state if page.segment.identity().pid == self.popen.pid else ""

    def stop(self, say: Say) -> int:
        """End it in any case: stop, then terminate, then kill; returns its exit code."""
        try:
            return self._end(say)
        finally:
            if self._keeper is not None:
                self._keeper.close()

    def _end(self, say: Say) -> int:
        if self.popen.poll() is None:
            self.popen.terminate()
        for seconds, last in ((STOP_S, self.popen.kill), (5.0, lambda: None)):
            end = monotonic_ns() + round(seconds * 1e9)
            while self.popen.poll() is None and monotonic_ns() < end:
                say(f"stopping {self.system}", None)
                pause(POLL_S)
            if self.popen.poll() is None:
                last()
        code = self.popen.wait()
        if code < 0 and not is_up(self.system):  # it had no time to end its processes and to remove its memory
            stop_system(self.system, say)
        return code


@contextlib.contextmanager
def up_meanwhile(request: StartRequest, timeout: float = START_S) -> Iterator[Background]:
    """A system, up within `timeout` s; down again on every path."""
    with progress(f"starting {request.system}") as say:
        background = Background(request, tied=True)
        try:
            background.wait_until_up(say, timeout)
        except BaseException:
            background.stop(say)
            raise
    try:
        yield background
    finally:
        with progress(f"stopping {request.system}") as say:
            background.stop(say)
