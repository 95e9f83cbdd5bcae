"""Lines of log files, with stamps that order them, and events, across processes.

    2026-11-22 20:50:01.123456 5012.345678 WARNING PSM1 axis 2 (insertion), board 6: …

Local date and time, CLOCK_MONOTONIC in seconds, severity, message. The file's name is the writer's. Lines without
stamps (tracebacks, output of libraries) are part of the line before them.
"""

from __future__ import annotations

import logging
import re
from dataclasses import dataclass
from datetime import datetime
from typing import TextIO

from trocar.shm.system.events import ERROR, STATUS, WARNING, Log
from trocar.shm.time.clock import monotonic_ns

LINE = re.compile(r"(?P<local>\d{4}-\d\d-\d\d \d\d:\d\d:\d\d\.\d+) (?P<seconds>\d+\.\d+) "
                  r"(?P<level>[A-Z]+) (?P<text>.*)")
LEVELS = {STATUS: logging.INFO, WARNING: logging.WARNING, ERROR: logging.ERROR}
STATUSES = 20
"""Lines of status that a process writes in a second, at most; warnings and errors it always writes."""


class Stamped(logging.Formatter):
    """One record as a line, with its logger's name unless that is the process `name`, the owner of the file."""

    def __init__(self, name: str = "") -> None:
        """Without a name each record is that process's own."""
        super().__init__()
        self._name = name

    def format(self, record: logging.LogRecord) -> str:
        """See the module."""
        return stamped(record.levelname, _reported(self, record, self._name), record.created)


def stamped(level: str, text: str, local_s: float) -> str:
    """A line as the module says, written at this local time (s since 1970)."""
    local = datetime.fromtimestamp(local_s).isoformat(" ", "microseconds")
    return f"{local} {monotonic_ns() * 1e-9:.6f} {level} {text}"


class Plain(logging.Formatter):
    """The same for a terminal, where lines are shown as they are written."""

    def format(self, record: logging.LogRecord) -> str:
        """Severity and message."""
        return f"{record.levelname} {_reported(self, record)}"


def _reported(formatter: logging.Formatter, record: logging.LogRecord, process: str = "") -> str:
    text = record.getMessage().removeprefix(f"{record.name}: ")
    if process and record.name not in (process, "root") and not is_about(text, record.name):
        text = f"{record.name}: {text}"
    return f"{text}\n{formatter.formatException(record.exc_info)}" if record.exc_info else text


def is_about(text: str, name: str) -> bool:
    """Whether a line begins with this name."""
    return re.match(rf"{re.escape(name)}(?![\w-])", text) is not None


def begin(stream: TextIO, name: str = "") -> None:
    """The log of process `name` goes to `stream` from now on."""
    handler = logging.StreamHandler(stream)
    handler.setFormatter(Plain() if stream.isatty() else Stamped(name))
    logging.basicConfig(level=logging.INFO, handlers=[handler])


def into(logger: logging.Logger) -> Log:
    """Destination of events besides their ring."""
    begun_ns = count = 0

    def write(severity: int, text: str) -> None:
        nonlocal begun_ns, count
        if severity == STATUS:
            now_ns = monotonic_ns()
            begun_ns, count = (begun_ns, count + 1) if now_ns - begun_ns < 1_000_000_000 else (now_ns, 1)
            if count > STATUSES:
                if count == STATUSES + 1:
                    logger.info("more of this second is not written here; trocar echo %s/status", logger.name)
                return
        logger.log(LEVELS[severity], "%s", text)

    return write


@dataclass(frozen=True, slots=True)
class LogLine:
    """One message; `local` is empty and `monotonic_s` 0 without stamps."""

    text: str
    level: str = ""
    local: str = ""
    monotonic_s: float = 0.0


def parsed(line: str) -> LogLine:
    """A line of a log file."""
    line = line.rstrip("\n")
    found = LINE.fullmatch(line)
    if found is None:
        return LogLine(line)
    return LogLine(found["text"], found["level"], found["local"], float(found["seconds"]))
