"""The newest entries of log files: each a line with stamps and those without that follow it, such as a traceback."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence

from trocar.shm.system.loglines import LogLine, is_about, parsed

MAX_LINES = 100
"""Of an entry at most, the newest ones: what a process prints has no stamps, and may be long."""


def about(lines: Sequence[str], name: str) -> list[str]:
    """The entries of one of several that write to the same file."""
    found: list[str] = []
    is_wanted = False
    for text in lines:
        line = parsed(text)
        is_wanted = is_about(line.text, name) if line.local else is_wanted
        found += [text] if is_wanted else []
    return found


def newest(files: Mapping[str, Sequence[str]], most: int) -> tuple[list[tuple[str, LogLine]], int]:
    """The newest `most` entries of several processes as they were written, and how many lines were left out."""
    found = [(entry[0].monotonic_s, name, entry) for name, lines in files.items() for entry in _last(lines, most)]
    found.sort(key=lambda row: row[0])
    shown = [(name, line) for _, name, entry in found[len(found) - min(most, len(found)):] for line in entry]
    return shown, sum(map(len, files.values())) - len(shown)


def _last(lines: Sequence[str], most: int) -> list[list[LogLine]]:
    """The newest entries of one process."""
    entries: list[list[LogLine]] = [[]]
    for line in map(parsed, itertools.islice(reversed(lines), MAX_LINES * most)):
        if len(entries) > most:
            break
        entries[-1].append(line)
        if line.local:
            entries.append([])
    return [entry[:MAX_LINES][::-1] for entry in reversed(entries[:most]) if entry]


def left_out(older: int, what: str, most: int) -> str:
    """What a person is told first of what is not shown; empty: that is all."""
    return f"… {older} older {what if older != 1 else what.removesuffix('s')}: -n {10 * most}" if older and most else ""


def in_order(lines: Mapping[str, Iterable[str]]) -> list[tuple[str, LogLine]]:
    """Lines of several processes by their stamps; one without goes with the line before it."""
    found: list[tuple[float, str, LogLine]] = []
    for name, each in lines.items():
        since_s = 0.0
        for line in map(parsed, each):
            since_s = line.monotonic_s or since_s
            found.append((since_s, name, line))
    found.sort(key=lambda row: row[0])
    return [(name, line) for _, name, line in found]
