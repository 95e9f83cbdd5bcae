"""Faults at full rate: what was is found among more records than one answer may have, in few chunks, each read once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import World
from tests.gui.test_past import PLOT, STATE, Then, kept, opened, was
from tests.tools.robot import ScriptedRobot, robot
from trocar.procs.gui import past as past_module
from trocar.procs.gui import recorded
from trocar.procs.recordings import names, picked, reading
from trocar.procs.recordings.chunks import uncompressed

MANY = 1500
PERIOD_S = 0.001
SIGNALS = [f"plot:PSM1/state.{name}[{i}]" for name in ("position", "setpoint_position") for i in range(6)]


@pytest.fixture
def chunks(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Sizes of the chunks that were uncompressed."""
    found: list[int] = []

    def counted(data: bytes, compression: str, size: int, crc: int) -> bytes:
        found.append(size)
        return uncompressed(data, compression, size, crc)

    monkeypatch.setattr(reading, "uncompressed", counted)
    return found


@pytest.fixture
def scripted(world: World) -> Iterator[ScriptedRobot]:
    with robot(world.name, MANY) as scripted:
        yield scripted


def at_full_rate(scripted: ScriptedRobot, folder: Path, then: Then) -> Path:
    """A fault 100 s ago, in a file; rings have lost it since."""
    for k in range(MANY - 1):
        scripted.show_arm(k * 1e-3, "ENABLED", stamp_ns=then.stamp(100.0 + PERIOD_S * (MANY - 1 - k)))
    path = kept(scripted, folder, names.FAULT, then.local(100.0))
    for k in range(2 * MANY):
        scripted.show_arm(9.0, "FAULT", stamp_ns=then.stamp(50.0 - 1e-3 * k))
    return path


def test_states_at_a_fault_are_found_in_few_chunks_however_much_is_recorded(
        scripted: ScriptedRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chunks: list[int]) -> None:
    then = Then()
    monkeypatch.setattr(recorded, "MAX_BYTES", 100_000)
    with opened(scripted, tmp_path) as past:
        at_full_rate(scripted, tmp_path, then)
        found = was(past, then.local(100.0), STATE, "scene", PLOT, "IO1/state", *SIGNALS, span_ms=1000)
        assert found[STATE]["state"] == "ENABLED" and abs(found[STATE]["position"][0] - 1.498) < 0.003
        assert found["scene"]["arms"]["PSM1"]["frames"]
        for name in (PLOT, *SIGNALS):
            assert "of records; choose a shorter time" in found[name]["problem"]
        states = was(past, then.local(100.3), STATE)[STATE]
        assert abs(states["position"][0] - 1.199) < 0.01 and states["age"] < 0.1
        chunks.clear()
        was(past, then.local(100.3), STATE, "scene", "messages")
        assert len(chunks) <= 2
        chunks.clear()
        was(past, then.local(100.0), PLOT, *SIGNALS, span_ms=1000)
        all_at_once = len(chunks)
        chunks.clear()
        was(past, then.local(100.0), PLOT, span_ms=1000)
        assert 0 < all_at_once <= len(chunks) <= 3, "none was read again after the failure"


def test_all_plots_of_a_request_are_read_in_one_pass(
        scripted: ScriptedRobot, tmp_path: Path, chunks: list[int]) -> None:
    then = Then()
    with opened(scripted, tmp_path) as past:
        path = at_full_rate(scripted, tmp_path, then)
        found = was(past, then.local(100.0), STATE, *SIGNALS, span_ms=1000, points=1900)
        assert all(990 <= len(found[name]["t"]) <= 1001 for name in SIGNALS)
        first = len(chunks)
        with reading.open_recording(path) as reader:
            assert first <= len(reader.chunks) + 1, "one of them for the states, too"
        chunks.clear()
        # The black box of the same time adds nothing.
        path.with_name(path.name.replace(names.FAULT, names.BOX)).write_bytes(path.read_bytes())
        again = was(past, then.local(100.0), STATE, *SIGNALS, span_ms=1000, points=1900)
        assert again == found and len(chunks) == first


def test_a_request_that_takes_too_long_ends_with_the_reason(
        scripted: ScriptedRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, chunks: list[int]) -> None:
    then = Then()
    with opened(scripted, tmp_path) as past:
        at_full_rate(scripted, tmp_path, then)
        monkeypatch.setattr(past_module, "WORK_S", -1.0)
        found = was(past, then.local(100.0), PLOT, *SIGNALS, span_ms=1000)
        assert all("takes too long" in row["problem"] for row in found.values()) and chunks == []
        assert was(past, then.local(20.0), STATE)[STATE]["state"] == "FAULT", "rings still have this time"


def test_a_chunk_without_its_index_is_searched(
        scripted: ScriptedRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    then = Then()
    with opened(scripted, tmp_path) as past:
        path = at_full_rate(scripted, tmp_path, then)
        with reading.open_recording(path) as reader:
            place = reader.chunks[-1]
            index, data = reader.index(place), reader.plain(place)
            walked = picked.indexed(data)
            assert index is not None and index.keys() == walked.keys()
            assert all((index[channel] == walked[channel]).all() for channel in index)
        before = was(past, then.local(100.0), STATE, span_ms=0)
        with path.open("r+b") as file:  # its writer was killed
            file.truncate(place.at + place.length + 5)
        assert was(past, then.local(100.0), STATE) == before


@pytest.mark.parametrize("wrong", [-5, 3, 1 << 40])
def test_an_index_with_wrong_offsets_harms_nothing(
        scripted: ScriptedRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, wrong: int) -> None:
    then, index = Then(), reading.RecordingReader.index

    def spoiled(self: reading.RecordingReader, place: reading.ChunkPlace) -> Any:
        found = index(self, place) or {}
        return {channel: rows + [0, wrong] for channel, rows in found.items()}

    monkeypatch.setattr(reading.RecordingReader, "index", spoiled)
    with opened(scripted, tmp_path) as past:
        at_full_rate(scripted, tmp_path, then)
        assert was(past, then.local(100.0), STATE)[STATE]["age"] is None
