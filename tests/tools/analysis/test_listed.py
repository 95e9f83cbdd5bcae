"""`trocar recordings`: what its table says of each file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from trocar.tools.cli import build
from trocar.tools.verbs import recordings


@pytest.mark.parametrize("kind", ["fault", "dump", "box", "named"])
def test_the_table_has_the_same_seconds_as_json(kind: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    row: dict[str, Any] = {"file": "a.mcap", "kind": kind, "time_ns": 20_000_000_000, "begin_ns": 3_000_000_000,
                           "end_ns": 10_500_000_000, "seconds": 7.5, "bytes": 1, "code": "", "reason": ""}
    monkeypatch.setattr(recordings, "described", lambda folder: [row])
    monkeypatch.setattr(recordings, "folder_of", lambda system: tmp_path)
    words = ["recordings", "--system", "any"]
    assert json.loads(CliRunner().invoke(build("recordings"), [*words, "--json"]).output)["seconds"] == 7.5
    shown = CliRunner().invoke(build("recordings"), words).output
    assert "real s" in shown.splitlines()[1] and " 7.5 " in shown and "-9" not in shown and "–" not in shown
