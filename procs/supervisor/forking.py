"""The supervisor's side of the template (procs/supervisor/template.py): starts it and requests processes from it."""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import select
import signal
import socket
from collections.abc import Collection, Sequence
from typing import Final

from trocar.procs.node.realtime import keep_with
from trocar.procs.supervisor import template
from trocar.procs.supervisor.template import READY
from trocar.shm.time.clock import monotonic_ns

PR_SET_CHILD_SUBREAPER: Final = 36
IMPORT_NS: Final = 20_000_000_000  # how long a start waits for the template to import
REPLY_S: Final = 0.3  # time limit for the fork of one process


class Forked:
    """A process that the template has forked for us; has the members of Popen that are used here."""

    def __init__(self, pid: int) -> None:
        """`pid`: of a child of ours; 0 is one that has ended."""
        self.pid, self.returncode = pid, None if pid else 0

    def poll(self) -> int | None:
        """The exit code after its end, negative for a signal; None while it runs."""
        if self.returncode is None:
            try:
                found, status = os.waitpid(self.pid, os.WNOHANG)
                self.returncode = os.waitstatus_to_exitcode(status) if found else None
            except ChildProcessError:  # `reap_orphans` has reaped it
                self.returncode = 0
        return self.returncode

    def send_signal(self, number: int) -> None:
        """Send it a signal, unless it has ended."""
        if self.poll() is None:
            os.kill(self.pid, number)

    def kill(self) -> None:
        """Send SIGKILL."""
        self.send_signal(signal.SIGKILL)

    def wait(self) -> None:
        """Wait for its end."""
        if self.returncode is None:
            self.returncode = os.waitstatus_to_exitcode(os.waitpid(self.pid, 0)[1])


def reap_orphans(known: Collection[int]) -> None:
    """Reap an ended process that is not among the known ones: a child that one of them left behind."""
    with contextlib.suppress(ChildProcessError):
        found = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        if found is not None and found.si_pid not in known:
            os.waitpid(found.si_pid, 0)


class Template:
    """The template of one system, from `start` to `close` or its end; without one, processes are fresh interpreters."""

    def __init__(self) -> None:
        """Start nothing yet."""
        self._forked: Forked | None = None
        self._is_ready, self._latest_ns = False, 0

    def start(self) -> None:
        """Fork it off our process, which has opened nothing yet; it begins to import, and we adopt its orphans."""
        _adopt_orphans(True)
        self._ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        supervisor = os.getpid()
        with theirs:
            if not (pid := os.fork()):
                self._ours.close()
                template.run(theirs, supervisor)
        self._forked, self._latest_ns = Forked(pid), monotonic_ns() + IMPORT_NS

    def prepare(self, system: str) -> None:
        """Let it decode the document of our system, which exists now; then it is ready."""
        if self._forked is not None:
            with contextlib.suppress(OSError):  # it has ended
                self._ours.send(system.encode())

    def has_imported(self) -> bool:
        """Whether it is ready, or further waiting is useless."""
        if not self._is_ready and self._forked is not None:
            with contextlib.suppress(OSError):
                self._is_ready = self._reply(0.0) == READY
        if self._is_ready or self._forked is None:
            return True
        return self._forked.poll() is not None or monotonic_ns() > self._latest_ns

    def fork(self, words: Sequence[str], output: int) -> Forked | None:
        """Fork a process with this command line; None: the template is not available."""
        if self._forked is None or not self.has_imported():
            return None
        with contextlib.suppress(OSError, ValueError):
            return self._ask(json.dumps([words, _own_environ()]).encode(), output, self._forked.pid)
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
        waits = select.poll()
        waits.register(self._ours, select.POLLIN)
        if not waits.poll(1e3 * most_s):
            raise TimeoutError
        return self._ours.recv(len(READY) + 20)

    def close(self) -> None:
        """Kill it; from now on, each process is a fresh interpreter."""
        if self._forked is not None:
            self._forked.kill()
            self._forked.wait()
            self._ours.close()
        self._forked, self._is_ready = None, False
        _adopt_orphans(False)


def _own_environ() -> dict[str, str]:
    """Our environment variables, some of them set after the start of the template."""
    return {name: value for name, value in os.environ.items() if name.startswith("TROCAR_")}


def _adopt_orphans(do: bool) -> None:
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, int(do), 0, 0, 0)
