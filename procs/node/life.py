"""Start and end of every process, ours or a user's: arguments, stop signals, and an exit code on every path."""

from __future__ import annotations

import argparse
import contextlib
import io
import signal
import sys
import traceback
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Final

from trocar.procs.document.system import SystemConfig, from_json
from trocar.procs.node.node_memory import NodeMemory
from trocar.procs.node.setup_error import exit_code, explains_itself
from trocar.shm.mailbox.origins import ACTING
from trocar.shm.system import directory, loglines

SETUP_FAILED: Final = 3
LOOP_FAILED: Final = 4


def arguments(kind: str) -> argparse.Namespace:
    """Parse the arguments that all processes have, system and name, and open the log, which is not buffered.

    From then on, commands of the process carry this name.
    """
    parser = argparse.ArgumentParser(prog=kind, description=f"One {kind}, started by trocar up.")
    parser.add_argument("--system", required=True)
    parser.add_argument("--name", required=True)
    chosen = parser.parse_args()
    loglines.begin(sys.stderr, chosen.name)
    ACTING.begin(chosen.name)
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(line_buffering=True)
    return chosen


def document_of(system: str) -> SystemConfig:
    """The document of a running system; SegmentError when there is none."""
    return from_json(directory.document(system))


@contextlib.contextmanager
def lived(node: NodeMemory, traces: bool = False) -> Iterator[None]:
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
