"""Birth and end of every process, ours or a user's: its arguments, what asks it to end, an exit code on every path."""

from __future__ import annotations

import argparse
import contextlib
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
from trocar.shm.system import directory, loglines

SETUP_FAILED: Final = 3
LOOP_FAILED: Final = 4


def arguments(kind: str) -> argparse.Namespace:
    """What every process is started with: its system and name; its log begins."""
    parser = argparse.ArgumentParser(prog=kind, description=f"One {kind}, started by trocar up.")
    parser.add_argument("--system", required=True)
    parser.add_argument("--name", required=True)
    chosen = parser.parse_args()
    loglines.begin(sys.stderr, chosen.name)
    return chosen


def document_of(system: str) -> SystemConfig:
    """What a running system is; SegmentError when there is none."""
    return from_json(directory.document(system))


@contextlib.contextmanager
def lived(node: NodeMemory) -> Iterator[None]:
    """The life of a process that has its place: what ends it is shown, and in its log, and decides the exit code."""
    on_stop(node.stop)
    why = ""
    try:
        yield
    except (Exception, SystemExit) as error:
        why = cause_of(error)
        if not isinstance(error, SystemExit) or error.code:
            running = node.page.state == "RUNNING"
            node.log.error("ended by an error: %s", error, exc_info=not explains_itself(error))
            node.page.show("FAILED", why)
            sys.exit(exit_code(error, LOOP_FAILED if running else SETUP_FAILED))
    why = why or node.stop_reason or "its main has returned"
    node.page.show("STOPPED", why)
    node.log.info("ended: %s", why)


def cause_of(error: BaseException) -> str:
    """What ended somebody's code: the error's name and text, or where it called sys.exit."""
    if explains_itself(error):
        return str(error)
    if not isinstance(error, SystemExit):
        return f"{type(error).__name__}: {error}"
    last = traceback.extract_tb(error.__traceback__)[-1]
    given = "" if error.code is None else repr(error.code)
    return f"sys.exit({given}) in {Path(last.filename).name} line {last.lineno}"


class TimeUp(BaseException):
    """Somebody else's code took longer than it may; not an Exception, which that code might catch."""


def limited(seconds: float, do: Callable[[], None]) -> None:
    """Call `do`; TimeUp is raised in its middle when it takes longer, unless it hangs where no Python code runs."""
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
