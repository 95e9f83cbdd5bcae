"""`trocar logs`: whole entries, the newest of all processes, and what is left out."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import pytest
from typer.testing import CliRunner

from trocar.tools import cli
from trocar.tools.verbs.logs import MAX_LINES, newest

TRACEBACK = ["Traceback (most recent call last):", '  File "box.py", line 3, in update', "ZeroDivisionError: no more"]


def line(seconds: int, text: str) -> str:
    return f"2026-11-22 20:50:{seconds:02d}.000000 {seconds}.000000 INFO {text}"


def logs(folder: Path, files: dict[str, Sequence[str]], *words: str) -> list[str]:
    (folder / "lab").mkdir(exist_ok=True)
    for name, lines in files.items():
        (folder / "lab" / f"{name}.log").write_text("".join(f"{each}\n" for each in lines))
    result = CliRunner().invoke(cli.build("logs"), ["logs", *words, "--system", "lab"])
    assert result.exit_code == 0, result.exception
    return result.stdout.splitlines()


@pytest.fixture
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    return tmp_path


def test_a_traceback_is_whole_and_what_is_older_is_counted(state: Path) -> None:
    files = {"box": [line(1, "begins"), line(2, "ended by an error"), *TRACEBACK, line(3, "begins")]}
    shown = logs(state, files, "box", "-n", "2")
    assert shown[0] == "… 1 older line: -n 20" and shown[1].endswith("ended by an error") and shown[2:5] == TRACEBACK
    assert len(shown) == 6 and len(logs(state, files, "box")) == 6
    assert all(json.loads(row)["process"] == "box" for row in logs(state, files, "box", "-n", "2", "--json"))


def test_of_several_the_newest_of_all_are_shown_without_a_hole(state: Path) -> None:
    files = {"box": [line(k, f"box {k}") for k in range(0, 40, 2)], "lab": [line(k, f"lab {k}") for k in (1, 3, 39)]}
    shown = logs(state, files, "-n", "5")
    assert [row.split()[-1] for row in shown[1:]] == ["32", "34", "36", "38", "39"]
    assert shown[0] == "… 18 older lines: -n 50"


def test_what_a_process_prints_without_end_does_not_fill_the_terminal() -> None:
    shown, older = newest({"box": [line(1, "begins"), *["it is all the same"] * 1000]}, 5)
    assert len(shown) == MAX_LINES and older == 1001 - MAX_LINES
    assert newest({"box": []}, 5) == ([], 0) and newest({"box": ["bare"]}, 0) == ([], 1)
