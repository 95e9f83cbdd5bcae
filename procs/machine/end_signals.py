"""Signals that end a program of a person: what it has open is closed, and what it does comes to its end in order."""

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
def ended_by_term() -> Iterator[None]:
    """Of a program of the main thread: SIGTERM ends it as Ctrl-C would, what it has open is closed; exit code 143."""
    def over(number: int, frame: FrameType | None) -> None:
        sys.exit(128 + number)

    before = signal.signal(signal.SIGTERM, over)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


@contextlib.contextmanager
def ended_as_by_ctrl_c() -> Iterator[None]:
    """SIGTERM, and SIGHUP of a terminal that is closed, do what Ctrl-C does; in the main thread, others hear of none.

    Only the first of them, so that none ends the ending. What is ignored (nohup) stays so.
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
    """Ctrl-C ends this program without a traceback, until `ctrl_c_raises`; for the time in which modules are loaded."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.SIG_DFL)


def ctrl_c_raises() -> None:
    """Ctrl-C is a KeyboardInterrupt, as Python begins with it."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


def ctrl_c_waits() -> None:
    """Ctrl-C waits until the program that takes our place, the supervisor, listens to it."""
    signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])


def ctrl_c_in_a_line() -> None:
    """From now on Ctrl-C ends a script without a traceback; all other errors have theirs."""
    before = sys.excepthook
    if before is sys.__excepthook__:
        sys.excepthook = partial(_ended, before)


def _ended(before: Hook, kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    if issubclass(kind, KeyboardInterrupt):
        sys.stderr.write("ended by Ctrl-C\n")
    else:
        before(kind, error, trace)
