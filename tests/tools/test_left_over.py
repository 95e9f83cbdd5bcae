"""What a dead system left in memory: kept if it can be, removed in any case, and nothing else is removed with it."""

from __future__ import annotations

import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from tests.tools.robot import ScriptedRobot
from trocar.procs.recordings import names
from trocar.procs.recordings.reading import open_recording
from trocar.shm.memory.segment import create, names_of, path_of, segment_name
from trocar.shm.time.lockstep import Table, create_clock
from trocar.tools import cli
from trocar.tools.output.printing import Say
from trocar.tools.systems import dumping
from trocar.tools.systems import report_file as reporting
from trocar.tools.systems.dumping import KEPT, keep_left_over, remove_older

QUIET: Say = lambda text, fraction: None  # noqa: E731
OURS = "died-20260101-00000{}.000.mcap"


@pytest.fixture
def dead(world: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ScriptedRobot]:
    """A system whose processes are gone; some records of its arm are left."""
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    made = ScriptedRobot(world.name)
    for number in range(5):
        made.show_arm(float(number))
    for page in made.pages.values():
        page.field("pid")[...] = 0
    made.close_ends()
    yield made
    world.remove()


@pytest.mark.slow
def test_what_was_kept_before_is_never_written_over(dead: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(dumping, "local_ns", lambda: 1_700_000_000_123_000_000)
    kept = [keep_left_over(dead.name, QUIET) for _ in range(3)]
    assert [path and path.name for path in kept] == [
        f"died-20231114-221320.123{number}.mcap" for number in ("", "-2", "-3")]
    for path in kept:
        assert path is not None
        with open_recording(path) as recording:
            assert len(recording.records("PSM1/state").rows) == 5


def test_the_newest_are_kept_and_what_a_person_made_is_left_alone(tmp_path: Path) -> None:
    others = ["dump-20200101-000000.000.mcap", "died-by-accident.mcap", "died-20200101-000000.000-grasp.mcap",
              "died-20200101.mcap", "dump-x-20200101-000000.000.mcap"]
    for name in [*others, *(OURS.format(number) for number in range(8)), OURS.format("7").replace(".000.", ".000-2.")]:
        (tmp_path / name).touch()
    set_back = tmp_path / "died-20250101-000000.000.mcap"
    set_back.touch()
    remove_older(set_back)
    left = {path.name for path in tmp_path.iterdir()}
    assert left - set(others) == {set_back.name, "died-20260101-000007.000-2.mcap",
                                  *(OURS.format(number) for number in (5, 6, 7))}
    assert len(left) == len(others) + KEPT


def overwritten(system: str, parts: tuple[str, ...], seed: int) -> None:
    """Anything may lie there: other versions, or what an accident has written."""
    path, chance = path_of(segment_name(*parts)), random.Random(seed)
    data = bytearray(path.read_bytes())
    for _ in range(200):
        data[chance.randrange(min(len(data), 4096))] = chance.randrange(256)
    path.write_bytes(data)


@pytest.mark.parametrize("seed", range(4))
def test_memory_that_cannot_be_read_holds_nobody_up(dead: ScriptedRobot, tmp_path: Path, seed: int) -> None:
    for number, parts in enumerate(sorted(names_of(dead.name))):
        overwritten(dead.name, parts, seed * 1000 + number)
    said = CliRunner().invoke(cli.build("down"), ["down", "--system", dead.name])
    assert said.exit_code == 0, said.output
    assert not names_of(dead.name)


def test_a_clock_page_of_another_version_is_told_and_the_rest_is_kept(dead: ScriptedRobot, tmp_path: Path,
                                                                     monkeypatch: pytest.MonkeyPatch) -> None:
    create_clock(dead.name, Table(()), create)
    page = path_of(segment_name(dead.name, "supervisor", "clock"))
    page.write_bytes(page.read_bytes().replace(b"advances", b"advanced"))
    path = keep_left_over(dead.name, QUIET)
    assert path is not None
    with open_recording(path) as recording:
        assert recording.metadata[names.SYSTEM]["clock"] == ""
        assert len(recording.records("PSM1/state").rows) == 5
    monkeypatch.setattr(reporting, "findings", lambda: iter(()))
    file = tmp_path / "report.tar.gz"
    said = CliRunner().invoke(cli.build("report"), ["report", str(file), "--system", dead.name])
    assert said.exit_code == 0, said.output


def test_a_schema_that_ros_cannot_say_is_told_and_the_rest_is_kept(dead: ScriptedRobot,
                                                                   monkeypatch: pytest.MonkeyPatch) -> None:
    from trocar.procs.recordings import writing

    usual = writing.layout_of

    def odd(kind: str, schema: Any) -> Any:
        if kind == "io":
            raise KeyError("f16")
        return usual(kind, schema)

    monkeypatch.setattr(writing, "layout_of", odd)
    path = keep_left_over(dead.name, QUIET)
    assert path is not None
    with open_recording(path) as recording:
        assert "IO1/state" not in recording.record_topics and len(recording.records("PSM1/state").rows) == 5
