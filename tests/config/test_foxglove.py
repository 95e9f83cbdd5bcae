"""The Foxglove server in a system file."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml

from tests.page_blocks import blocks, system_of, system_with, typed
from tests.system.robot import ROOT
from trocar.procs.config import load_system
from trocar.procs.config.loading import bridges
from trocar.procs.document.bridges import FoxgloveServer

FILE = ROOT / "configs" / "systems" / "kinematic.yaml"


def test_it_is_there_where_the_file_says_so() -> None:
    assert "foxglove" not in {row.name for row in load_system(FILE).system.processes}  # type: ignore[union-attr]
    system = load_system(FILE, sets=["foxglove.rate_hz=50"]).system
    assert system is not None and system.foxglove == FoxgloveServer("127.0.0.1:8765", 50.0)
    row = system.process("foxglove")
    assert (row.kind, row.period_s, row.priority, row.start) == ("foxglove", 0.02, 0, "always") and "PSM1" in row.after


@pytest.mark.parametrize("text", ["foxglove.listen=192.0.2.1:8765", "foxglove.listen=8765", "foxglove.rate_hz=0.5",
                                  "foxglove.tls={certificate: none.pem, key: none.pem}", "foxglove.unknown=1"])
def test_what_makes_no_sense_is_refused(text: str) -> None:
    assert load_system(FILE, sets=[text]).errors


def test_the_blocks_of_the_page_start_a_server_with_the_values_that_it_gives(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bridges, "missing", lambda *_: "")
    (section,), (line,) = blocks("foxglove.md", "yaml"), typed("foxglove.md")
    (defaults,) = [yaml.safe_load(f"{{{row.partition('#')[2]}}}") for row in section.splitlines() if "#" in row]
    assert system_with(section, tmp_path).foxglove == system_of(line).foxglove == FoxgloveServer(**defaults)
