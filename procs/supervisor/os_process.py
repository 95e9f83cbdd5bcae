"""The operating-system process of an instance: a fork of the template or a fresh interpreter."""

from __future__ import annotations

import contextlib
import os
import re
import signal
import socket
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from trocar.procs.document.system import Process
from trocar.procs.machine.paths import PACKAGE, ROOT
from trocar.procs.machine.verb_lines import verb_line
from trocar.procs.node.setup_error import SETUP_FAILED, STAYS
from trocar.procs.supervisor.forking import Forked, Template
from trocar.procs.tables.manifest import proc
from trocar.shm.system.loglines import stamped
from trocar.shm.time.clock import local_ns
from trocar.shm.time.control_page import ControlPage

TRACE: Final = re.compile(r"most recent call first\):\n((?:  File .*\n?)+)")
FRAME: Final = re.compile(r'  File "(?P<file>.*)", line (?P<line>\d+) in (?P<function>.*)')
NOT_THEIRS: Final = (str(PACKAGE), sysconfig.get_path("stdlib"), "<")
LIBRARIES: Final = re.compile(r"/(site|dist)-packages/")
TRACE_BYTES: Final = 1 << 16
HANDOVER = Path(__file__).with_name("handover.py")


@dataclass(slots=True)
class OsProcess:
    """The process of one instance, or none. Most kinds are forked off the template, if that is available.

    The process inherits the listening `sockets`, which stay open here, too. Its output goes to the file `log`.
    """

    system: str
    row: Process
    page: ControlPage
    log: Path
    template: Template
    sockets: Sequence[socket.socket] = ()
    popen: subprocess.Popen[bytes] | Forked | None = None
    _log_size: int = 0  # before the trace of a hang

    @property
    def pid(self) -> int:
        """Process id, 0 when none runs."""
        return self.popen.pid if self.popen is not None else 0

    @property
    def ready(self) -> bool:
        """Whether its setup has succeeded and it runs."""
        return self.popen is not None and self.page.state == "RUNNING"

    def begin(self) -> None:
        """Start the process; OSError when that fails."""
        self.page.show("CREATED")
        self._log_size = self._size()
        command = [sys.executable, "-m", proc(self.row.kind).module, "--system", self.system, "--name", self.row.name]
        environ: dict[str, str] = {}
        given = [each.fileno() for each in self.sockets]
        if given:
            command = [sys.executable, "-I", "-S", str(HANDOVER), ",".join(map(str, given)), *command]
            environ = {"LISTEN_FDS": str(len(given)), "LISTEN_FDNAMES": ":".join([self.row.name] * len(given))}
        with self.log.open("ab") as log:
            forked = self.template.fork(command, log.fileno()) if proc(self.row.kind).is_forked else None
            self.popen = forked or subprocess.Popen(
                command, cwd=ROOT, stdin=subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True,
                env={**os.environ, **environ}, pass_fds=given,
            )

    def ask_to_end(self) -> None:
        """Send SIGTERM."""
        self._signal(signal.SIGTERM, signal.SIGCONT)  # a stopped process must wake to end

    def abort(self) -> None:
        """Send SIGABRT: Python writes a trace of each thread and ends (faulthandler, procs/node/runtime.py)."""
        self._announce_trace()
        self._signal(signal.SIGABRT, signal.SIGCONT)

    def trace(self) -> None:
        """Send SIGUSR1: Python writes a trace of its main thread and resumes (faulthandler, procs/node/runtime.py)."""
        self._announce_trace()
        self._signal(signal.SIGUSR1)

    def _announce_trace(self) -> None:
        """Write a stamped line to its log, because the trace that follows has no time stamps."""
        with contextlib.suppress(OSError), self.log.open("a", encoding="utf-8") as log:
            text = "does not respond; where it is follows, unless it is stopped"
            log.write(stamped("WARNING", text, local_ns() * 1e-9) + "\n")
        self._log_size = self._size()

    @property
    def is_stopped(self) -> bool:
        """Whether a signal (SIGSTOP) or a debugger has stopped it."""
        with contextlib.suppress(OSError):
            stat = Path(f"/proc/{self.pid}/stat").read_text(encoding="utf-8", errors="replace")
            return stat.rpartition(")")[2].split()[0] in ("T", "t")
        return False

    def where(self) -> str:
        """File, line and function of its trace: the innermost of the user's code, else the top; empty without a trace.
        """
        begin = self._log_size if self._size() >= self._log_size else 0  # a new file has begun
        with contextlib.suppress(OSError), self.log.open("rb") as log:
            log.seek(begin)
            if trace := TRACE.search(log.read(TRACE_BYTES).decode(errors="replace")):
                frames = list(FRAME.finditer(trace[1]))
                found = next(filter(_is_theirs, frames), frames[0])
                return f"{Path(found['file']).name} line {found['line']} in {found['function']}"
        return ""

    def _size(self) -> int:
        """Size of its log in bytes; 0 if it was removed."""
        with contextlib.suppress(OSError):
            return self.log.stat().st_size
        return 0

    def kill(self) -> None:
        """Send SIGKILL."""
        self._signal(signal.SIGKILL)

    def _signal(self, *numbers: signal.Signals) -> None:
        if self.popen is not None:
            for number in numbers:
                self.popen.send_signal(number)

    def ended(self) -> int | None:
        """The exit code, reported once after the end, negative for a signal; None: it runs, or there is no process."""
        if self.popen is None or self.popen.poll() is None:
            return None
        code, self.popen = self.popen.returncode, None
        return code

    def in_words(self, code: int) -> str:
        """How it ended, with the error on its page."""
        if code < 0:
            try:
                return f"killed by {signal.Signals(-code).name}"
            except ValueError:
                return f"killed by signal {-code}"
        reported = bytes(self.page.field("error")[()]).rstrip(b"\0").decode(errors="replace")
        if reported and (code == STAYS or reported.startswith("sys.exit(")):  # the exit code adds nothing
            return reported
        if code == SETUP_FAILED and not reported:  # its page is where an error is shown
            return f"it could not attach to its shared memory; {verb_line(f'logs {self.row.name}', self.system)}"
        return f"exit code {code}" + (f": {reported}" if reported else "")

    def show_stopped(self, also_failed: bool = False) -> None:
        """Show STOPPED if it had no time to do so itself; FAILED stays, unless `also_failed`."""
        if self.page.state not in ("STOPPED", *(() if also_failed else ("FAILED",))):
            self.page.show("STOPPED")


def _is_theirs(frame: re.Match[str]) -> bool:
    """Whether a line of a trace is of a user's file: neither ours nor a library's."""
    return not (frame["file"].startswith(NOT_THEIRS) or LIBRARIES.search(frame["file"]))
