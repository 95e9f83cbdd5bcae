"""A disk without room, played by a limit of the size of files: verbs that write say so, and leave nothing half."""

from __future__ import annotations

import contextlib
import os
import resource
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tests.recordings.made import a_recording
from trocar.tools import cli

ROOM = 4_000  # bytes


@contextlib.contextmanager
def little_room(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(sys, "dont_write_bytecode", True)  # or half of it is kept
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


@pytest.mark.parametrize("form", ["csv", "rosbag2"])
def test_an_export_says_that_there_is_no_room_and_leaves_nothing_half(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, form: str) -> None:
    recording, _ = a_recording(tmp_path, 2000)
    wanted = ["export", str(recording), "--format", form, "-o", str(tmp_path / "out")]
    with little_room(monkeypatch):
        result = CliRunner().invoke(cli.build("export"), wanted)
    assert result.exit_code == 1 and "File too large" in result.stderr and "Traceback" not in result.stderr
    assert not (tmp_path / "out").exists()
    assert CliRunner().invoke(cli.build("export"), wanted).exit_code == 0, "with room it works"


def test_a_report_says_that_there_is_no_room_and_leaves_nothing_half(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path / "state"))
    logs = tmp_path / "state" / "gone"
    logs.mkdir(parents=True)
    (logs / "PSM1.log").write_bytes(os.urandom(100_000))
    file = tmp_path / "report.tar.gz"
    with little_room(monkeypatch):
        result = CliRunner().invoke(cli.build("report"), ["report", str(file), "--system", "gone"])
    assert result.exit_code == 1 and "cannot be written" in result.stderr and not file.exists()
