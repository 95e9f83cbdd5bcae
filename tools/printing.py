"""How verbs talk: JSON lines for programs, tables for eyes, progress on the error stream.

What they say is partly text of others: of processes, boards, files. A terminal would obey what is in it (ESC begins a
command), so nothing gets there that has not passed `printable`.
"""

from __future__ import annotations

import contextlib
import json
import math
import select
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from procs.crtk.plain import plain as plain
from shm.clock import monotonic_ns

SLOW_NS = 2_000_000_000
Say = Callable[[str, float | None], None]
REPLACED = "\ufffd"


def printable(text: str, keep: str = "\n\t") -> str:
    """Text of others as a terminal may have it: what it would obey, or hide, instead of showing it is �."""
    return text if text.isprintable() else "".join(c if c.isprintable() or c in keep else REPLACED for c in text)


def tell(text: str, *, flush: bool = False) -> None:
    """A line, or some, for a person."""
    print(printable(text), flush=flush)


def need_reader() -> None:
    """BrokenPipeError when nobody reads our output any more: who waits for what comes seldom would not notice."""
    output = select.poll()
    try:
        output.register(sys.stdout.fileno(), 0)
    except (OSError, ValueError):  # no file
        return
    if any(what & select.POLLERR for _, what in output.poll(0)):
        raise BrokenPipeError("nobody reads the output")


def emit(row: Any) -> None:
    """One JSON object on one line, out at once; what is not printable is escaped, and comes back as it was."""
    text = json.dumps(plain(row), ensure_ascii=False)
    print(text if text.isprintable() else "".join(c if c.isprintable() else json.dumps(c)[1:-1] for c in text),
          flush=True)


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], right: Sequence[str] = ()) -> None:
    """A table for eyes; the columns named in `right` are flush right."""
    from rich.console import Console

    class OurConsole(Console):
        """One that lets others hear that nobody reads; rich's own ends the program, as if something was wrong."""

        def on_broken_pipe(self) -> None:
            raise BrokenPipeError("nobody reads the output")

    console = OurConsole(highlight=False, soft_wrap=False)
    if not console.is_terminal:  # a pipe has no width of its own: nothing is cut
        console = OurConsole(highlight=False, width=240)
    console.print(made_table(title, columns, rows, right))


def made_table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], right: Sequence[str] = ()) -> Any:
    """The same table as a rich object, for live displays."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    made = Table(title=Text(printable(title), "table.title") if title else None, box=SIMPLE_HEAD, title_justify="left",
                 pad_edge=False, collapse_padding=True)
    for column in columns:
        whole = column in right or column == columns[0]
        made.add_column(column, justify="right" if column in right else "left", no_wrap=whole)
    for row in rows:
        made.add_row(*(Text(printable(cell)) for cell in row))
    return made


def note(text: str) -> None:
    """A line for a person, on the error stream: it never mixes with data."""
    print(printable(text), file=sys.stderr, flush=True)


@contextlib.contextmanager
def progress(what: str) -> Iterator[Say]:
    """`say(text, fraction)` shows a bar once two seconds are over; a fraction of None means it is not known."""
    if not sys.stderr.isatty():
        yield lambda text, fraction: None
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
    """A number for a table; a dash when there is none."""
    return "–" if value is None or not math.isfinite(value) else format(value, form)


def span(seconds: float | None) -> str:
    """A time as people read it: 0.3 s, 12 s, 4 min, 3 h."""
    if seconds is None:
        return "–"
    if seconds < 9.95:
        return f"{max(0.0, seconds):.1f} s"
    for limit, unit, each in ((100.0, "s", 1.0), (6000.0, "min", 60.0), (172800.0, "h", 3600.0)):
        if seconds < limit:
            return f"{seconds / each:.0f} {unit}"
    return f"{seconds / 86400.0:.0f} days"
