"""What a test may try again, and which skips CI allows."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests import retries, skips
from trocar.procs.tables import codes


@pytest.fixture(autouse=True)
def counted(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The retries and skips of these tests do not count for the run."""
    made: list[str] = []
    monkeypatch.setattr(retries, "made", made)
    monkeypatch.setattr(skips, "found", set())
    return made


def tries(log: Path, problems: list[str], reported: str = "") -> tuple[int, str]:
    """How often an attempt with these problems, one after the other, is made, and the last problem."""
    left = list(problems)

    def attempt() -> str:
        with log.open("a") as file:
            file.write(reported)
        return left.pop(0)

    last = retries.retry(attempt, lambda: log.parent.glob("*.log"), "it")
    return len(problems) - len(left), last


def test_a_failure_is_tried_again_only_where_the_system_reported_that_it_was_too_busy(
        tmp_path: Path, counted: list[str]) -> None:
    log = tmp_path / "io.log"
    log.write_text(codes.PERIOD.remedy)  # of before
    assert tries(log, ["it failed", ""])[0] == 1 and counted == []
    busy = codes.HELD_UP.remedy_for("PSM1")
    assert tries(log, ["it failed", ""], busy) == (2, "") and len(counted) == 1
    assert tries(log, ["this program stalled for 1.2 s", ""]) == (2, "")


def test_what_fails_each_time_fails_in_the_end(tmp_path: Path) -> None:
    count, last = tries(tmp_path / "io.log", ["it failed"] * 9, codes.BOARDS_LATE.remedy)
    assert count == retries.MOST and "it failed" in last


@pytest.mark.parametrize(("reason", "strict", "fails"), [
    ("no tmux: real terminals untested", "strict", True), ("no tmux: real terminals untested", "", False),
    ("no native library: TROCAR_NATIVE is 0", "strict", False)])
def test_a_skip_that_is_not_listed_fails_in_ci(
        reason: str, strict: str, fails: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(skips.STRICT, strict)
    skips.note(pytest.TestReport("tests/a.py::test", ("a.py", 1, "test"), {}, "skipped", ("a.py", 1, reason), "setup"))
    assert skips.are_too_many() == fails
