"""Output of verbs: JSON lines for programs, tables for people, progress on the error stream.

Part of the output is text of others: of processes, boards, files. A terminal would execute control characters in it
(ESC begins a command), so all text passes through `printable`.
"""

from __future__ import annotations

import contextlib
import json
import math
import os
import select
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any, TextIO

from trocar.procs.crtk.plain import plain as plain
from trocar.shm.time.clock import monotonic_ns
from trocar.tools.output.tables import table_lines, wrapped
from trocar.tools.output.terminal import is_utf8, redraws

SLOW_NS, NOW_AND_THEN_NS, LINES_NS = 2_000_000_000, 5_000_000_000, 10_000_000_000
Say = Callable[[str, float | None], None]
REPLACED = "\ufffd"
PIPED = 120
"""Columns without a terminal."""


def printable(text: str, keep: str = "\n\t") -> str:
    """Text of others made safe for a terminal: characters that it would execute, or hide, become �."""
    return text if text.isprintable() else "".join(c if c.isprintable() or c in keep else REPLACED for c in text)


def tell(text: str, *, flush: bool = False, indent: str | None = "") -> None:
    """Lines for a person; on a terminal broken between words, with all but the first ones indented.

    `indent` None: not broken, as a command that a person copies.
    """
    shown = printable(text)
    if indent is not None and sys.stdout.isatty():
        shown = "\n".join(wrapped(shown, width(), indent))
    print(shown, flush=flush)


def need_reader() -> None:
    """BrokenPipeError if our output has no reader any more: a wait for rare events would not detect that."""
    output = select.poll()
    try:
        output.register(sys.stdout.fileno(), 0)
    except (OSError, ValueError):  # no file
        return
    if any(what & select.POLLERR for _, what in output.poll(0)):
        raise BrokenPipeError("the output is closed")


def emit(*rows: Any) -> None:
    """JSON objects, a line each, flushed at once; characters that are unprintable, or that our output lacks, are
    escaped, and decode to the original."""
    for row in rows:
        text = json.dumps(plain(row), ensure_ascii=not is_utf8())
        print(text if text.isprintable() else "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in text),
              flush=True)


def answer(row: Any, text: str, as_json: bool) -> None:
    """One result: JSON for programs, a line for a person."""
    if as_json:
        emit(row)
    else:
        tell(text)


def width(stream: TextIO | None = None) -> int:
    """Columns of the terminal of our output, or of another `stream`, or the value of `COLUMNS`; a pipe: PIPED."""
    given = os.environ.get("COLUMNS", "")
    if given.isdecimal():
        return max(int(given), 1)
    with contextlib.suppress(OSError, ValueError):  # no terminal, no file
        return os.get_terminal_size((stream or sys.stdout).fileno()).columns or PIPED
    return PIPED


def page(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], right: Sequence[str] = ()) -> str:
    """A table for eyes, as wide as the terminal; the columns named in `right` are flush right."""
    within = width()
    cells = [[printable(cell) for cell in row] for row in rows]
    lines = wrapped(printable(title), within) if title else []
    return "\n".join(lines + table_lines(columns, cells, right, within))


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], right: Sequence[str] = ()) -> None:
    """The same on our output."""
    print(page(title, columns, rows, right), flush=True)


def note(text: str) -> None:
    """A line for a person, on the error stream: it never mixes with data."""
    print(printable(text), file=sys.stderr, flush=True)


class LiveLine:
    """A line on a terminal's error stream that is overwritten repeatedly; elsewhere an occasional line."""

    def __init__(self) -> None:
        self._is_terminal, self._next_ns = redraws(sys.stderr), 0

    def show(self, parts: Sequence[str]) -> None:
        """The parts that fit, each whole, the first ones with priority."""
        if self._is_terminal:
            text = printable(fitting(parts, width(sys.stderr) - 1), "")
            print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)
        elif monotonic_ns() >= self._next_ns:
            self._next_ns = monotonic_ns() + NOW_AND_THEN_NS
            note("  ".join(parts))

    def report(self, text: str) -> None:
        """Something that stays on the screen."""
        print("\r\033[K" if self._is_terminal else "", end="", file=sys.stderr)
        note("\n".join(wrapped(text, width(sys.stderr))))

    def close(self) -> None:
        """The next line is a new one."""
        print("\n" if self._is_terminal else "", end="", file=sys.stderr, flush=True)


def fitting(parts: Iterable[str], within: int) -> str:
    """One line of at most `within` letters: those parts for which there is room after the ones before them."""
    line = ""
    for part in parts:
        longer = f"{line}  {part}" if line else part
        line = longer if len(longer) <= within else line
    return line


@contextlib.contextmanager
def progress(what: str) -> Iterator[Say]:
    """`say(text, fraction)` shows a bar after two seconds; a fraction of None means unknown.

    Without a terminal it writes a line every ten seconds.
    """
    if not redraws(sys.stderr):
        next_ns = monotonic_ns() + LINES_NS

        def line(text: str, fraction: float | None) -> None:
            nonlocal next_ns
            if monotonic_ns() >= next_ns:
                next_ns = monotonic_ns() + LINES_NS
                note(text if text == what else f"{what}: {text}")

        yield line
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    bar = Progress(*columns, console=Console(stderr=True), transient=True)
    task = bar.add_task(what, total=None)
    begin = monotonic_ns()

    def say(text: str, fraction: float | None) -> None:
        if not bar.live.is_started and monotonic_ns() - begin > SLOW_NS:
            bar.start()
        total = None if fraction is None else 1.0
        bar.update(task, description=escape(printable(text)), total=total, completed=fraction or 0.0)

    try:
        yield say
    finally:
        bar.stop()


def number(value: float | None, form: str = ".1f") -> str:
    """A number for a table; a dash if unknown."""
    return "–" if value is None or not math.isfinite(value) else format(value, form)


def counted(count: int, what: str) -> str:
    """A count with its noun: 1 value, 3 values."""
    return f"{count} {what}" if count == 1 else f"{count} {what}s"


def span(seconds: float | None) -> str:
    """A duration in readable form: 0.3 s, 12 s, 4 min, 3 h."""
    if seconds is None:
        return "–"
    if seconds < 9.95:
        return f"{max(0.0, seconds):.1f} s"
    for limit, unit, each in ((100.0, "s", 1.0), (6000.0, "min", 60.0), (172800.0, "h", 3600.0)):
        if seconds < limit:
            return f"{seconds / each:.0f} {unit}"
    return f"{seconds / 86400.0:.0f} days"
