"""Lines of logs: stamps of both clocks, whom they are about said once, tracebacks whole."""

from __future__ import annotations

import io
import logging
import sys

import pytest

from trocar.shm.system.events import ERROR, STATUS
from trocar.shm.system.loglines import STATUSES, LogLine, Stamped, into, parsed
from trocar.shm.time.clock import monotonic_ns


@pytest.fixture
def log() -> tuple[logging.Logger, io.StringIO]:
    out = io.StringIO()
    handler = logging.StreamHandler(out)
    handler.setFormatter(Stamped())
    logger = logging.Logger("PSM1")
    logger.addHandler(handler)
    return logger, out


def test_a_line_is_read_as_it_was_written(log: tuple[logging.Logger, io.StringIO]) -> None:
    logger, out = log
    before = monotonic_ns() * 1e-9
    into(logger)(ERROR, "PSM1 axis 2 (insertion), board 6: too far")
    line = parsed(out.getvalue())
    assert (line.level, line.text) == ("ERROR", "PSM1 axis 2 (insertion), board 6: too far")
    assert before - 1e-5 <= line.monotonic_s <= monotonic_ns() * 1e-9 + 1e-5 and len(line.local) == 26


def test_the_name_of_the_log_is_not_said_in_it(log: tuple[logging.Logger, io.StringIO]) -> None:
    logger, out = log
    logger.warning("PSM1: stalled")
    assert parsed(out.getvalue()).text == "stalled"


def test_a_traceback_follows_its_line(log: tuple[logging.Logger, io.StringIO]) -> None:
    logger, out = log
    try:
        raise ValueError("no")
    except ValueError:
        logger.error("ended by an error", exc_info=sys.exc_info())
    first, *rest = out.getvalue().splitlines()
    assert parsed(first).text == "ended by an error" and rest[-1] == "ValueError: no"
    assert parsed(rest[-1]) == LogLine("ValueError: no")


def test_status_is_written_but_not_without_end(log: tuple[logging.Logger, io.StringIO],
                                               monkeypatch: pytest.MonkeyPatch) -> None:
    logger, out = log
    now_ns = 5_000_000_000
    monkeypatch.setattr("trocar.shm.system.loglines.monotonic_ns", lambda: now_ns)
    write = into(logger)
    for _ in range(3 * STATUSES):
        write(STATUS, "PSM1: position limit: yaw")
        write(ERROR, "PSM1: too far")
    now_ns += 1_000_000_000
    write(STATUS, "PSM1: HOMED")
    lines = [parsed(line) for line in out.getvalue().splitlines()]
    assert sum(line.text == "position limit: yaw" for line in lines) == STATUSES
    assert sum(line.level == "ERROR" for line in lines) == 3 * STATUSES
    assert sum("trocar echo PSM1/status" in line.text for line in lines) == 1
    assert (lines[-1].level, lines[-1].text) == ("INFO", "HOMED")
