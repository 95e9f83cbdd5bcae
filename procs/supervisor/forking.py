"""The supervisor's side of the template (procs/supervisor/template.py): starts it and requests processes from it."""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Collection, Sequence
from typing import Final

from trocar.procs.machine.paths import ROOT
from trocar.procs.node.realtime import keep_with
from trocar.procs.supervisor import template
from trocar.procs.supervisor.template import READY
from trocar.shm.time.clock import monotonic_ns

PR_SET_CHILD_SUBREAPER: Final = 36
IMPORT_NS: Final = 20_000_000_000  # how long a start waits for the template to import
REPLY_S: Final = 0.3  # time limit for the fork of one process
ENVIRON: Final = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1",  # no thread pools in control code
                  "PYTHONIOENCODING": "utf-8"}  # logs are UTF-8, whatever the terminal of `up` is
PADDING: Final = 160  # bytes for the command lines of processes, with two names, beside those of the template


class Forked:
    """A process that the template has forked for us; has the members of Popen that are used here."""

    def __init__(self, pid: int) -> None:
        """`pid`: of a child of ours; 0 is one that has ended."""
        self.pid, self.returncode = pid, None if pid else 0

    def poll(self) -> int | None:
        """The exit code after its end, negative for a signal; None while it runs."""
        if self.returncode is None:
            found, status = os.waitpid(self.pid, os.WNOHANG)
            self.returncode = os.waitstatus_to_exitcode(status) if found else None
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send it a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """Send SIGKILL."""
        self.send_signal(signal.SIGKILL)


def reap_orphans(known: Collection[int]) -> None:
    """Reap an ended process that is not among the known ones: a child that one of them left behind."""
    with contextlib.suppress(ChildProcessError):
        found = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        if found is not None and found.si_pid not in known:
            os.waitpid(found.si_pid, 0)


class Template:
    """The template of one system, from `start`, or the first `fork`, to `close`."""

    def __init__(self) -> None:
        """Start nothing yet."""
        self._popen: subprocess.Popen[bytes] | None = None
        self._is_ready, self._latest_ns = False, 0

    def start(self) -> subprocess.Popen[bytes]:
        """Start the template, which begins to import; from now on we adopt its orphans."""
        _adopt_orphans(True)
        self._ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            command = [sys.executable, "-m", template.__name__, str(theirs.fileno()), " " * PADDING]
            self._popen = subprocess.Popen(command, cwd=ROOT, stdin=subprocess.DEVNULL, pass_fds=[theirs.fileno()],
                                           env={**os.environ, **ENVIRON}, start_new_session=True)
        self._latest_ns = monotonic_ns() + IMPORT_NS
        return self._popen

    def has_imported(self) -> bool:
        """Whether it is ready, or further waiting is useless."""
        running = self._popen or self.start()
        if not self._is_ready:
            with contextlib.suppress(OSError):
                self._is_ready = self._reply(0.0) == READY
        return self._is_ready or running.poll() is not None or monotonic_ns() > self._latest_ns

    def fork(self, words: Sequence[str], output: int) -> Forked | None:
        """Fork a process with this command line; None: the template is not available."""
        if not self.has_imported() or self._popen is None:
            return None
        with contextlib.suppress(OSError, ValueError):
            return self._ask(json.dumps([words, _own_environ()]).encode(), output, self._popen.pid)
        self.close()
        return None

    def _ask(self, request: bytes, output: int, pid: int) -> Forked:
        """Request a process; OSError without a reply in time: then no process begins."""
        keep_with(pid)
        waiting, begin = os.pipe()
        try:
            socket.send_fds(self._ours, [request], [output, waiting])
            child = int(self._reply(REPLY_S))
            os.write(begin, b"b")
        finally:
            os.close(waiting)
            os.close(begin)
        return Forked(child)

    def _reply(self, most_s: float) -> bytes:
        if not select.select([self._ours], [], [], most_s)[0]:
            raise TimeoutError
        return self._ours.recv(len(READY) + 20)

    def close(self) -> None:
        """Kill the template; the next request starts another one."""
        if self._popen is not None:
            self._popen.kill()
            self._popen.wait()
            self._ours.close()
        self._popen, self._is_ready = None, False
        _adopt_orphans(False)


def _own_environ() -> dict[str, str]:
    """Our environment variables, some of them set after the start of the template."""
    return {name: value for name, value in os.environ.items() if name.startswith("TROCAR_")}


def _adopt_orphans(do: bool) -> None:
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, int(do), 0, 0, 0)
