"""Start and end of every process, ours or a user's: arguments, stop signals, and an exit code on every path."""

from __future__ import annotations

import contextlib
import functools
import io
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING, Final

from trocar.procs.document.system import SystemConfig, from_json
from trocar.procs.node.node import Node
from trocar.procs.node.setup_error import SETUP_FAILED, exit_code, explains_itself
from trocar.shm.mailbox.origins import ACTING
from trocar.shm.system import directory, loglines

if TYPE_CHECKING:
    from _typeshed import ReadableBuffer as Buffer

LOOP_FAILED: Final = 4
MISUSED: Final = 2
_decoded = functools.lru_cache(1)(from_json)


class LogFile(io.FileIO):
    """The log of a process. What the disk has no room for is lost; the process continues."""

    def write(self, data: Buffer) -> int:
        """The number of bytes, also of lost ones."""
        try:
            return super().write(data)
        except OSError:
            return memoryview(data).nbytes


@dataclass(frozen=True, slots=True)
class Arguments:
    """The command line of a process."""

    system: str
    name: str


def arguments(kind: str) -> Arguments:
    """Read the arguments that all processes have, system and name, and open the log, which is not buffered.

    From then on, commands of the process carry this name. Not by argparse, which would cost each process 2 MB.
    """
    match sys.argv[1:]:
        case ["--system", system, "--name", name]:
            chosen = Arguments(system, name)
        case _:
            sys.stderr.write(f"usage: {kind} --system SYSTEM --name NAME; trocar up starts it\n")
            sys.exit(MISUSED)
    if sys.stdout is sys.__stdout__ and sys.stderr is sys.__stderr__:
        sys.stdout, sys.stderr = (io.TextIOWrapper(io.BufferedWriter(LogFile(number, "w", closefd=False)), "utf-8",
                                                   "backslashreplace", line_buffering=True) for number in (1, 2))
    loglines.begin(sys.stderr, chosen.name)
    ACTING.begin(chosen.name)
    return chosen


def document_of(system: str) -> SystemConfig:
    """The document of a running system; SegmentError when there is none. One decoded before a fork is used again."""
    return _decoded(directory.document(system))


@contextlib.contextmanager
def lived(node: Node, traces: bool = False) -> Iterator[None]:
    """Run the body as a process that has claimed its instance; its end is shown, logged and sets the exit code.

    `traces`: errors that explain themselves are logged with a trace as well.
    """
    on_stop(node.stop)
    why = ""
    try:
        yield
    except (Exception, SystemExit) as error:
        why = cause_of(error)
        if not isinstance(error, SystemExit) or error.code:
            running = node.page.state == "RUNNING"
            node.log.error("ended by an error: %s", why, exc_info=traces or not explains_itself(error))
            node.page.show("FAILED", why)
            sys.exit(exit_code(error, LOOP_FAILED if running else SETUP_FAILED))
    why = why or node.stop_reason or "its main has returned"
    node.page.show("STOPPED", why)
    node.log.info("ended: %s", why)


def cause_of(error: BaseException) -> str:
    """The cause in words: the error's name and text, or the location of a call of sys.exit."""
    if explains_itself(error):
        return str(error)
    if not isinstance(error, SystemExit):
        return f"{type(error).__name__}: {error}"
    last = traceback.extract_tb(error.__traceback__)[-1]
    given = "" if error.code is None else repr(error.code)
    return f"sys.exit({given}) in {Path(last.filename).name} line {last.lineno}"


class TimeUp(BaseException):
    """A user's code took longer than allowed; not an Exception, because that code might catch those."""


def limited(seconds: float, do: Callable[[], None]) -> None:
    """Call `do`; TimeUp interrupts it after `seconds`, unless it hangs outside of Python code."""
    def over(number: int, frame: FrameType | None) -> None:
        raise TimeUp(f"it took more than {seconds:g} s")

    signal.signal(signal.SIGALRM, over)
    signal.setitimer(signal.ITIMER_REAL, seconds)
    try:
        do()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)


def on_stop(stop: Callable[[str], None]) -> None:
    """Call `stop` with the reason when the supervisor asks this process to end."""
    def asked(number: int, frame: FrameType | None) -> None:
        stop("asked to stop")

    signal.signal(signal.SIGTERM, asked)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
