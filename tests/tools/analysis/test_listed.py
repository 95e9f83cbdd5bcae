"""`trocar recordings`: what its table says of each file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from trocar.tools.cli import build
from trocar.tools.verbs import recordings


def test_a_file_that_may_not_be_read_is_named_and_the_others_are_listed(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
) -> None:
    closed = tmp_path / "box-20260131-235959.123.mcap"
    closed.touch()
    died: dict[str, Any] = {"kind": "dump", "reason": "its system is dead"}

    class ListedRecording:
        metadata, begin_ns, end_ns = {recordings.names.SYSTEM: died}, 3_000_000_000, 10_500_000_000

        def __init__(self, path: Path) -> None:
            if path == closed:
                raise recordings.RecordingError(f"{path}: Permission denied")

        def __enter__(self) -> ListedRecording:
            return self

        def __exit__(self, *_: object) -> None: ...

    monkeypatch.setattr(recordings, "open_recording", ListedRecording)
    monkeypatch.setattr(recordings, "folder_of", lambda system: tmp_path)
    (tmp_path / "died-20260131-235959.123.mcap").touch()
    for kind, is_listed in (("died", True), ("dump", True), ("box", False)):
        done = CliRunner().invoke(build("recordings"), ["recordings", kind, "--system", "any", "--json"])
        assert done.exit_code == 0 and str(closed) in done.stderr and "Permission denied" in done.stderr
        assert ("died-20260131" in done.stdout) is is_listed


@pytest.mark.parametrize("kind", ["fault", "dump", "box", "named"])
def test_the_table_has_the_same_seconds_as_json(kind: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    row: dict[str, Any] = {"file": "a.mcap", "kind": kind, "time_ns": 20_000_000_000, "begin_ns": 3_000_000_000,
                           "end_ns": 10_500_000_000, "seconds": 7.5, "bytes": 1, "code": "", "reason": ""}
    monkeypatch.setattr(recordings, "described", lambda folder: ([row], []))
    monkeypatch.setattr(recordings, "folder_of", lambda system: tmp_path)
    words = ["recordings", "--system", "any"]
    assert json.loads(CliRunner().invoke(build("recordings"), [*words, "--json"]).output)["seconds"] == 7.5
    _, head, *rows = CliRunner().invoke(build("recordings"), words).output.splitlines()
    assert "real s" in head and any(" 7.5 " in row for row in rows)
    assert not any("-9" in row or "–" in row for row in rows)
