"""Key presses while a verb shows data."""

from __future__ import annotations

import contextlib
import select
import sys
import termios
import tty
from collections.abc import Callable, Iterator


@contextlib.contextmanager
def keys() -> Iterator[Callable[[], str]]:
    """`pressed()` returns the pressed key, or nothing; without a terminal always nothing."""
    if not sys.stdin.isatty():
        yield lambda: ""
        return
    descriptor = sys.stdin.fileno()
    before = termios.tcgetattr(descriptor)
    tty.setcbreak(descriptor)
    try:
        yield lambda: sys.stdin.read(1) if select.select([sys.stdin], [], [], 0.05)[0] else ""
    finally:
        termios.tcsetattr(descriptor, termios.TCSADRAIN, before)
