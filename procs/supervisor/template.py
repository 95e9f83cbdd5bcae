"""The template: a process that has imported the loops of real-time kinds, has opened nothing, and forks processes.

A fresh interpreter needs 0.3 s of a core for imports, and shares none of its memory. A fork of the template begins in
milliseconds and shares the imported modules; the recorder imports the rest itself. Each request on the socket is one
process: its command line, new environment variables, a descriptor for its output and one that signals its start. The
reply is its process id.

The template itself is forked off the supervisor before that has opened anything. Each process is forked twice; the
intermediate process ends at once, so that the supervisor, which adopts orphans, becomes the parent. The template ends
when source files have changed since their import, or the supervisor is gone.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import json
import os
import signal
import socket
import sys
import traceback
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Final, NoReturn

from trocar.procs.machine.imports import many_imports
from trocar.procs.machine.paths import PACKAGE, ROOT
from trocar.procs.native.library import native
from trocar.procs.native.sources import files
from trocar.procs.node.life import document_of
from trocar.procs.supervisor.memory import create_rest
from trocar.procs.tables.arm_types import ARM_TYPES, found
from trocar.shm.memory.segment import SegmentError, size_of

READY: Final = b"ready"
MOST: Final = 1 << 16  # bytes of a request
PR_SET_PDEATHSIG: Final = 1
ARGUMENTS_AT: Final = 47  # in /proc/self/stat: first and last address of the command line, counted from 0


def run(asking: socket.socket, supervisor: int) -> NoReturn:
    """In the fork: import, serve until the supervisor has gone; in each process, run the `main` of its module."""
    die_with(supervisor)
    show([sys.executable, "-m", __name__])
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])  # the supervisor blocks it until it has a handler
    os.setsid()
    os.chdir(ROOT)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    with many_imports():
        import_loops()
        prepare(asking.recv(MOST).decode())
    module = serve(asking)
    end(run_module(module) if module else 0)


def die_with(supervisor: int) -> None:
    """In a fork of the supervisor: let the kernel kill us when it has ended."""
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)  # also while stopped; forks do not inherit it
    if os.getppid() != supervisor:
        os._exit(0)


def import_loops() -> None:
    """Import the loops of real-time kinds."""
    os.environ["MUJOCO_GL"] = "disable"  # else MuJoCo loads a library of windows, too
    for row in importlib.import_module("trocar.procs.tables.manifest").PROCS:
        if row.realtime and row.priority != "emulation":  # MuJoCo takes 10 MB, which many systems do not need
            importlib.import_module(row.module)
    for arm in ARM_TYPES.values():
        for name in filter(None, (arm.process, arm.inverse)):
            found(name)
    native()


def prepare(system: str) -> None:
    """Decode the document of the system and all layouts, for all processes at once; they report what is wrong."""
    with contextlib.suppress(SegmentError, ValueError):
        create_rest(document_of(system), size_of)


def run_module(module: str) -> int:
    """Run a module's `main`; returns the exit code."""
    return traced(importlib.import_module(module).main)


def traced(do: Callable[[], int | None]) -> int:
    """Its result, 0 for None, as an exit code; errors are printed."""
    try:
        return do() or 0
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
        return 1


def end(code: int) -> NoReturn:
    """Exit without finalizing the interpreter, which would copy all memory that is shared with the template."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def serve(asking: socket.socket) -> str:
    """Serve requests. Returns empty in the template, which ends; in a new process, the name of its module."""
    stamps = _stamps(_sources())
    with contextlib.suppress(OSError):  # the supervisor has ended
        asking.send(READY)
        while True:
            request, given, _, _ = socket.recv_fds(asking, MOST, 2)
            if not request or stamps != _stamps(stamps):
                return ""
            child = _fork()
            if not child:
                asking.close()
                return _become(*json.loads(request), *given)
            for each in given:
                os.close(each)
            asking.send(str(child).encode())
    return ""


def _sources() -> Iterator[str]:
    """The source files of our imported modules, and of the native library."""
    yield from map(str, files())
    for module in tuple(sys.modules.values()):
        file = getattr(module, "__file__", None) or ""
        if file.startswith(str(PACKAGE)):
            yield file


def _stamps(files: Iterable[str]) -> dict[str, int]:
    """Modification time of each file, ns; 0 if it is gone."""
    return {file: Path(file).stat().st_mtime_ns if Path(file).exists() else 0 for file in files}


def _fork() -> int:
    """The id of a new process without a parent, which the supervisor has adopted; 0 in that process."""
    reading, writing = os.pipe()
    between = os.fork()
    if between:
        os.waitpid(between, 0)
        child = int(os.read(reading, 20))
    else:
        child = os.fork()
        if child:
            os.write(writing, str(child).encode())
            os._exit(0)
    os.close(reading)
    os.close(writing)
    return child


def _become(words: list[str], environ: dict[str, str], output: int, begin: int) -> str:
    """In the new process: wait for the start signal, then set session, output and command line; returns the module."""
    if not os.read(begin, 1):  # our process id did not reach the supervisor in time
        end(0)
    os.close(begin)
    os.setsid()
    os.environ.update(environ)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.close(output)
    sys.argv = words[2:]  # after "python -m"
    show(words)
    return words[2]


def show(words: list[str]) -> None:
    """Overwrite our command line with that of this process, for `ps` and searches for our processes."""
    fields = Path("/proc/self/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    begin, end = (int(fields[k - 2]) for k in (ARGUMENTS_AT, ARGUMENTS_AT + 1))
    shown = "\0".join(words).encode()[: end - begin - 1]
    ctypes.memmove(begin, shown.ljust(end - begin, b"\0"), end - begin)
