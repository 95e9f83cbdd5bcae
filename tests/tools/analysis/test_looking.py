"""Recordings looked at as systems are: their rings, what was said, which there are."""

from __future__ import annotations

import json
import tracemalloc
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from tests.conftest import World
from tests.recordings.made import WIDE, a_recording
from trocar.procs.crtk.topics import catalogue
from trocar.procs.recordings import names
from trocar.procs.recordings.facts import facts_of
from trocar.procs.recordings.snapshot import take
from trocar.shm.memory.segment import names_of
from trocar.shm.system import directory
from trocar.shm.system.events import ERROR, Events
from trocar.shm.time.system_time import SystemTime
from trocar.shm.topics import EVENTS, SETPOINT
from trocar.tools import cli
from trocar.tools.analysis import as_system
from trocar.tools.analysis.as_system import LookedAt, recording_as_system, system_or_recording
from trocar.tools.analysis.choosing import opened
from trocar.tools.output.errors import Problem

SECOND_NS = 1_000_000_000


@pytest.fixture
def fault(world: World, tmp_path: Path) -> Path:
    """A recording of an arm whose setpoint jumped when it said so."""
    directory.create_ring(world.name, "PSM1", SETPOINT, {}, {"kind": "arm"})
    directory.create_ring(world.name, "PSM1", EVENTS, {}, {"kind": "arm"})
    writer = directory.writer(world.name, "PSM1", "setpoint", "arm")
    events = directory.writer(world.name, "PSM1", "events", "arm")
    for number in range(1000):
        writer.field("position")[...] = 0.5 if number >= 600 else 0.0
        writer.publish(SECOND_NS + number * 1_000_000)
        if number == 600:
            said = Events(events, lambda: SECOND_NS + 600_000_000)
            said.emit("error", "PSM1: it jumped", severity=ERROR, code="jump", component="PSM1", hint="look at it")
    writer.close()
    events.close()
    file = tmp_path / "fault-20260101-000000.000-PSM1.mcap"
    with file.open("xb", buffering=0) as stream:
        take(world.name, stream, facts_of(world.name, names.FAULT, file.stem, "PSM1: it jumped"), [])
    world.remove()
    return file


def asked(verb: str, *words: str) -> tuple[int, str]:
    """Exit code and output."""
    result = CliRunner().invoke(cli.build(verb), [verb, *words])
    return result.exit_code, result.output


@pytest.mark.slow
def test_its_rings_are_read_as_those_of_a_dead_system(fault: Path) -> None:
    with recording_as_system(fault) as system:
        assert "PSM1/setpoint" in [entry.name for entry in catalogue(system)]
        reader = directory.reader(system, "PSM1", "setpoint", "arm")
        rows = reader.last(5000)
        assert len(rows) == 1000 and list(rows["stamp_ns"][[0, -1]]) == [SECOND_NS, SECOND_NS + 999_000_000]
        assert (rows["position"][:, 0] == np.where(np.arange(1000) >= 600, 0.5, 0.0)).all()
        assert reader.newest() and reader.field("position")[0] == 0.5 and reader.gone
        reader.close()
    assert not [name for name in names_of() if name[0] == system]


def test_scope_shows_the_moment_of_a_fault(fault: Path) -> None:
    code, said = asked("scope", "PSM1/setpoint.position[0]", "--when", "event PSM1 error", "--past", "--json",
                       "--before", "0.01", "--after", "0.01", "--recording", str(fault))
    assert code == 0, said
    assert json.loads(said.splitlines()[0])["moment_ns"] == SECOND_NS + 600_000_000


def test_of_a_recording_that_is_longer_than_rings_a_stretch_is_looked_at(
        fault: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(as_system, "MOST", 300)
    parts = (LookedAt(), 700, 999), (LookedAt(0.1, 0.3), 100, 299), (LookedAt(0.0, 0.5), 200, 499)
    for part, first_ns, last_ns in parts:
        with recording_as_system(fault, part=part) as system:
            reader = directory.reader(system, "PSM1", "setpoint", "arm")
            rows = reader.last(5000)
            reader.close()
            assert list((rows["stamp_ns"][[0, -1]] - SECOND_NS) // 1_000_000) == [first_ns, last_ns]
            with SystemTime(system) as time:
                assert time.now_ns() == rows["stamp_ns"][-1]
        said = capsys.readouterr().err
        assert ("only those from" in said) == (part != LookedAt(0.1, 0.3))


@pytest.mark.parametrize(("part", "most", "shown"), [(LookedAt(0.5, 1.0), 5000, 500), (LookedAt(), 500, 500)],
                         ids=["a stretch", "what a ring holds"])
@pytest.mark.slow
def test_how_much_memory_it_takes_does_not_depend_on_the_length_of_the_recording(
        tmp_path: Path, monkeypatch: pytest.MonkeyPatch, part: LookedAt, most: int, shown: int) -> None:
    monkeypatch.setattr(as_system, "MOST", most)
    peaks = []
    for count in (2_000, 8_000):
        path, _ = a_recording(tmp_path, count, f"{count}.mcap", WIDE, per_chunk=500, rate_hz=1000.0)
        tracemalloc.start()
        with recording_as_system(path, part=part) as system:
            reader = directory.reader(system, "PSM1", "state")
            assert reader.head == shown
            reader.close()
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.3 * peaks[0], peaks


def test_a_file_may_be_called_anything(fault: Path) -> None:
    other = fault.with_name("Ärger am (Montag) & so weiter.mcap")
    fault.rename(other)
    code, said = asked("scope", "PSM1/setpoint.position[0]", "--json", "--from", "0.2", "--to", "0.4", "--recording",
                       str(other))
    assert code == 0, said
    assert asked("scope", "PSM1/setpoint.position[0]", "--from", "0.2")[0] == 2


def test_one_that_is_open_is_told_and_nothing_else_is_taken_for_that(fault: Path) -> None:
    with recording_as_system(fault), pytest.raises(Problem, match="is open already"), recording_as_system(fault):
        pass
    with pytest.raises(KeyError, match="of the reader"), system_or_recording(str, None, fault):
        raise KeyError("of the reader")


def test_what_did_not_happen_in_it_is_told(fault: Path) -> None:
    code, said = asked("scope", "PSM1/setpoint.position[0]", "--when", "PSM1/setpoint.position[0] > 9", "--past",
                       "--recording", str(fault))
    assert code == 1 and f"did not happen in {fault}" in said


def test_logs_say_what_was_said(fault: Path) -> None:
    code, said = asked("logs", "--recording", str(fault))
    assert code == 0 and "error jump  PSM1: it jumped; look at it" in said
    code, said = asked("logs", "PSM1", "--recording", str(fault), "--json")
    assert json.loads(said)["code"] == "jump"
    assert asked("logs", "PSM2", "--recording", str(fault)) == (0, "")
    assert asked("logs", "--commands", "--recording", str(fault)) == (0, "")


def test_a_recording_is_found_by_the_name_in_the_list_of_recordings(
        fault: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    folder = tmp_path / "lab" / "recordings"
    folder.mkdir(parents=True)
    fault.rename(folder / fault.name)
    listed = json.loads(asked("recordings", "--json", "--system", "lab")[1])["file"]
    code, said = asked("logs", "--recording", listed)
    assert code == 0 and "it jumped" in said
    with pytest.raises(Problem):
        opened(Path("fault-20260101-000000.000-PSM2.mcap"))


def test_logs_say_what_is_wrong_with_a_recording(fault: Path) -> None:
    whole = fault.read_bytes()
    fault.write_bytes(whole[: whole.rindex(b"\x0f\x04" + bytes(7))])
    code, said = asked("logs", "--recording", str(fault))
    assert code == 0 and "error jump  PSM1: it jumped" in said and "its writer did not close it" in said


def test_recordings_are_listed_with_their_reasons(fault: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    folder = tmp_path / "mine" / "recordings"
    folder.mkdir(parents=True)
    fault.rename(folder / fault.name)
    a_recording(folder)
    (folder / "broken.mcap").write_text("no recording")
    code, said = asked("recordings", "--system", "mine", "--json")
    assert code == 0, said
    rows = [json.loads(line) for line in said.splitlines() if line.startswith("{")]
    assert "broken.mcap" in said
    assert {row["file"]: row["kind"] for row in rows} == {fault.name: names.FAULT, "one.mcap": names.BOX}
    new_year = round(datetime(2026, 1, 1, tzinfo=UTC).timestamp()) * SECOND_NS
    assert next(row["time_ns"] for row in rows if row["file"] == fault.name) == new_year, "when it was"
    code, said = asked("recordings", "fault", "--system", "mine")
    assert code == 0 and "PSM1: it jumped" in said and "one.mcap" not in said
    assert f"{datetime.fromtimestamp(new_year // SECOND_NS):%Y-%m-%d %H:%M:%S}" in said
    assert asked("recordings", "flaut", "--system", "mine")[0] == 1


def test_a_file_that_is_no_recording_is_told(tmp_path: Path) -> None:
    file = tmp_path / "no.mcap"
    file.write_text("no recording at all")
    with pytest.raises(Problem, match="is no MCAP file"), recording_as_system(file):
        pass
    code, said = asked("logs", "--recording", str(tmp_path / "nowhere.mcap"))
    assert code == 1 and "no such file" in said
