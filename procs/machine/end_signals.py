"""Signals that end a command-line program: open resources are closed, and the work is ended in order."""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from functools import partial
from types import FrameType, TracebackType

Hook = Callable[[type[BaseException], BaseException, TracebackType | None], object]


@contextlib.contextmanager
def ended_as_by_ctrl_c() -> Iterator[None]:
    """SIGTERM, and SIGHUP from a closed terminal, act like Ctrl-C; no effect outside of the main thread.

    Only the first signal counts, so that no second one interrupts the cleanup. Ignored signals (nohup) stay ignored.
    """
    is_main = threading.current_thread() is threading.main_thread()
    ours = [number for number in (signal.SIGTERM, signal.SIGHUP)
            if is_main and signal.getsignal(number) != signal.SIG_IGN]

    def over(number: int, frame: FrameType | None) -> None:
        for each in ours:
            signal.signal(each, signal.SIG_IGN)
        raise KeyboardInterrupt

    before = [(number, signal.signal(number, over)) for number in ours]
    try:
        yield
    finally:
        for number, handler in before:
            signal.signal(number, handler)


def ctrl_c_ends() -> None:
    """Let Ctrl-C end this program without a traceback, until `ctrl_c_raises`; for use while modules are loaded."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def ctrl_c_raises() -> None:
    """Let Ctrl-C raise KeyboardInterrupt, as is Python's default."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def ctrl_c_waits() -> None:
    """Block Ctrl-C until the supervisor, which replaces this program, has its handler."""
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])


def ctrl_c_in_a_line() -> None:
    """Let Ctrl-C end a script with one line instead of a traceback; other errors keep theirs."""
    before = sys.excepthook
    if before is sys.__excepthook__:
        sys.excepthook = partial(_ended, before)


def _ended(before: Hook, kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if issubclass(kind, KeyboardInterrupt):
        sys.stderr.write("ended by Ctrl-C\n")
    else:
        before(kind, error, trace)
