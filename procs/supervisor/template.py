"""The template: a process that has imported the loops of most kinds, opened nothing, and forks off those that run.

    python -m trocar.procs.supervisor.template SOCKET PADDING

A fresh interpreter imports for 0.3 s of a core before it can begin, and shares none of its memory. A fork of the
template begins in milliseconds and shares what was imported. Each request on the socket is one process: its command
line, what is new in its environment, a descriptor for its output and one that says when it may begin. The reply is its
process id.

Each process is forked twice. The one between ends at once, so that the supervisor, which adopts orphans, becomes the
parent. When source files have changed since they were imported, or the supervisor is gone, the template ends.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import json
import os
import signal
import socket
import sys
import traceback
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Final, NoReturn

from trocar.procs.machine.paths import PACKAGE

READY: Final = b"ready"
MOST: Final = 1 << 16  # bytes of a request
PR_SET_PDEATHSIG: Final = 1
ARGUMENTS_AT: Final = 47  # in /proc/self/stat: first and last address of the command line, counted from 0


def main() -> None:
    """Serve until the supervisor has gone; in each process that was forked off, what its module's `main` does."""
    signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])  # the supervisor holds it back until it listens to it
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0)  # also while stopped; forks do not inherit it
    asking = socket.socket(fileno=int(sys.argv[1]))
    for row in importlib.import_module("trocar.procs.tables.manifest").PROCS:
        if row.is_forked:
            importlib.import_module(row.module)
    gc.collect()
    gc.freeze()  # a collection in a forked process would touch, and so copy, all of it
    module = _serve(asking, _stamps(_sources()))
    if module:
        _end(_run(module))


def _run(module: str) -> int:
    """The exit code of the process whose `main` this module has."""
    try:
        sys.modules[module].main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else int(end.code is not None)
    except BaseException:
        traceback.print_exc()
        return 1
    return 0


def _end(code: int) -> NoReturn:
    """End without tearing down the interpreter: that would copy all memory that is shared with the template."""
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def _serve(asking: socket.socket, stamps: dict[str, int]) -> str:
    """Empty: this is the template, and it ends. Else this is a new process, of this module."""
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
    """The files of ours that are imported."""
    for module in tuple(sys.modules.values()):
        file = getattr(module, "__file__", None) or ""
        if file.startswith(str(PACKAGE)):
            yield file


def _stamps(files: Iterable[str]) -> dict[str, int]:
    """When each file was changed, ns; 0: it is gone."""
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
    """The new process shows its own command line, has its own session and output, and begins when it may."""
    if not os.read(begin, 1):  # the supervisor has not heard of us in time
        _end(0)
    os.close(begin)
    os.setsid()
    os.environ.update(environ)
    os.dup2(output, 1)
    os.dup2(output, 2)
    os.close(output)
    sys.argv = words[2:]  # after "python -m"
    _show(words)
    return words[2]


def _show(words: list[str]) -> None:
    """Write a command line for `ps`, and for who looks for our processes, over that of the template."""
    fields = Path("/proc/self/stat").read_text().rpartition(")")[2].split()
    begin, end = (int(fields[k - 2]) for k in (ARGUMENTS_AT, ARGUMENTS_AT + 1))
    shown = "\0".join(words).encode()[: end - begin - 1]
    ctypes.memmove(begin, shown.ljust(end - begin, b"\0"), end - begin)


if __name__ == "__main__":
    main()
