"""The log of a process on a page: its end, never more, and only of processes that there are."""

from __future__ import annotations

from pathlib import Path

import pytest

from procs.document.system import from_json
from procs.gui.log_source import LETTERS, LINES, LOOK_NS, LogSource, log_of
from shm import directory
from tests.conftest import World
from tests.tools.robot import robot

LINE = "2026-11-22 20:50:01.123456 5012.345678 WARNING axis 2: <b>hot</b>\n"


def test_the_newest_lines_are_shown_and_what_is_appended(tmp_path: Path) -> None:
    file = tmp_path / "PSM1.log"
    file.write_text(LINE + "a traceback\n")
    source = LogSource(file)
    assert source.read(0)["rows"] == [("20:50:01.123", "WARNING", "axis 2: <b>hot</b>"), ("", "", "a traceback")]
    shown = source.read(LOOK_NS)
    assert source.read(2 * LOOK_NS) is shown, "nothing was written: it is not read again"
    with file.open("a") as log:
        log.write("more\n")
    assert source.read(2 * LOOK_NS + 1) is shown, "not so often"
    assert source.read(3 * LOOK_NS)["rows"][-1] == ("", "", "more")
    file.write_text("it began anew\n")
    assert source.read(4 * LOOK_NS)["rows"] == [("", "", "it began anew")]


def test_a_large_log_costs_no_more_than_a_small_one(tmp_path: Path) -> None:
    file = tmp_path / "PSM1.log"
    file.write_bytes(LINE.encode() * 20_000 + b"x" * 5000 + b"\n\xff\xfe\n")
    rows = LogSource(file).read(0)["rows"]
    assert len(rows) == LINES and len(rows[-2][2]) == LETTERS and rows[-1][2] == "\ufffd\ufffd"


def test_only_logs_of_processes_are_shown(world: World, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    with robot(world.name) as scripted:
        document = from_json(directory.document(scripted.name))
        for name in ("../PSM1", "/etc/passwd", "", "PSM1.1"):
            with pytest.raises(ValueError, match="no process"):
                log_of(document, name)
        with pytest.raises(OSError, match=r"PSM1\.log"):
            log_of(document, "PSM1")().read(0)
