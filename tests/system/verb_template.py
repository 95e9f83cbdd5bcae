"""Verbs in forks of a process that has imported them; a fresh interpreter and its supervisor import for 2 s of a core.

    python -m tests.system.verb_template SOCKET ROOM

The forks are those of procs/supervisor/template.py. Where a verb replaces its process by the supervisor's, the fork
stays, and runs the supervisor's module.
"""

from __future__ import annotations

import ctypes
import importlib
import json
import os
import socket
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NoReturn

from trocar.procs.machine.end_signals import ctrl_c_ends, ctrl_c_raises
from trocar.procs.machine.imports import many_imports
from trocar.procs.supervisor import template
from trocar.procs.supervisor.forking import PR_SET_CHILD_SUBREAPER, Forked

ROOT = Path(__file__).resolve().parents[2]
IMPORTED = ("trocar.tools.cli", "trocar.tools.verbs.up", "trocar.tools.verbs.demo", "trocar.procs.supervisor.loop",
            "trocar.procs.supervisor.run", "trocar.procs.recorder.loop")
ROOM = 1000
FOLDER = "TROCAR_TEST_FOLDER"
"""Environment variable: where a verb is typed, if not in the project's folder."""
REPLY_S = 60.0


class Verb(Forked):
    """A verb's process, a child of ours; has the members of Popen that tests use."""

    def wait(self, timeout: float = 600.0) -> int:
        """The exit code after its end; subprocess.TimeoutExpired."""
        end = time.monotonic() + timeout
        while (code := self.poll()) is None:
            if time.monotonic() > end:
                raise subprocess.TimeoutExpired(f"process {self.pid}", timeout)
            time.sleep(0.002)
        return code

    def __enter__(self) -> Verb:
        return self

    def __exit__(self, *_: object) -> None:
        self.wait()


class VerbTemplate:
    """The template of verbs, from its start to `close`."""

    def __init__(self) -> None:
        self._ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        environ = {name: value for name, value in os.environ.items() if not name.startswith("TROCAR_")}
        with theirs:
            self._popen = subprocess.Popen([sys.executable, "-m", __name__, str(theirs.fileno()), " " * ROOM], cwd=ROOT,
                                           env={**environ, "OMP_NUM_THREADS": "1"}, pass_fds=[theirs.fileno()])
        assert self._ours.recv(100) == template.READY

    def begin(self, words: Sequence[str], environ: Mapping[str, str], output: int) -> Verb:
        """Begin a verb in a process of its own with these new environment variables."""
        _adopt_orphans(True)
        waiting, begin = os.pipe()
        command = [sys.executable, "-m", "trocar", *words]
        socket.send_fds(self._ours, [json.dumps([command, dict(environ)]).encode()], [output, waiting])
        self._ours.settimeout(REPLY_S)
        process = Verb(int(self._ours.recv(100)))
        _adopt_orphans(False)  # what a dead supervisor leaves is init's
        os.write(begin, b"b")
        os.close(waiting)
        os.close(begin)
        return process

    def close(self) -> None:
        """End it; its processes are not affected."""
        self._ours.close()
        self._popen.wait()


def _adopt_orphans(do: bool) -> None:
    ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, int(do), 0, 0, 0)


def main() -> None:
    """Import, and serve; in a fork, run the verb."""
    asking = socket.socket(fileno=int(sys.argv[1]))
    with many_imports():
        for module in IMPORTED:
            importlib.import_module(module)
        template.import_loops()
    os.execve = _replaced  # type: ignore[assignment]
    if template.serve(asking):
        ctrl_c_ends()
        os.chdir(os.environ.pop(FOLDER, "."))
        template.end(template.run_module("trocar.tools.cli"))


def _replaced(path: object, words: Sequence[str], environ: Mapping[str, str]) -> NoReturn:
    """What os.execve does, as far as a supervisor can tell."""
    os.environ.clear()
    os.environ.update(environ)
    sys.orig_argv = list(words)
    after: Any = words.index("-m") + 1
    sys.argv = list(words[after:])
    ctrl_c_raises()
    template.end(template.run_module(words[after]))


if __name__ == "__main__":
    main()
