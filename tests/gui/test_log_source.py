"""The log of a process on a page: its end, never more, and only of processes that there are."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.conftest import World
from tests.tools.robot import robot
from trocar.procs.document.system import from_json
from trocar.procs.gui.log_source import LETTERS, LINES, LOOK_NS, LogSource, log_of
from trocar.procs.gui.sources import AGAIN_NS, Sources
from trocar.shm.system import directory

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
        assert "PSM1.log" in log_of(document, "PSM1")().read(0)["problem"]


def test_a_log_that_is_not_there_says_so_all_the_time_and_is_shown_when_it_comes(tmp_path: Path) -> None:
    file = tmp_path / "PSM1.log"
    source = LogSource(file)
    for now_ns in (0, 1, LOOK_NS // 2, LOOK_NS, LOOK_NS + 1):
        shown = source.read(now_ns)
        assert "PSM1.log" in shown["problem"] and "rows" not in shown, now_ns
    file.write_text(LINE)
    assert len(source.read(3 * LOOK_NS)["rows"]) == 1
    file.unlink()
    assert "rows" not in source.read(4 * LOOK_NS)


def test_a_source_that_cannot_be_opened_says_why_until_it_is_tried_again() -> None:
    def absent() -> LogSource:
        raise OSError("it is not there")

    sources = Sources({"one": absent})
    for now_ns in (0, 1, AGAIN_NS - 1, AGAIN_NS):
        sources.begin(now_ns)
        assert b"it is not there" in sources.part("one"), now_ns
