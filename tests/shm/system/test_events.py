"""Events: strictly increasing stamps, history for late comers, texts that fit."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest

from trocar.procs.tables import codes
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.system.events import ERROR, STATUS, WARNING, Events
from trocar.shm.time.clock import local_ns, monotonic_ns
from trocar.shm.topics import EVENTS


@pytest.fixture
def ends(world: Any) -> Iterator[tuple[Events, RingReader]]:
    """Events of PSM1 on a clock that stands still, and a reader."""
    directory.create_ring(world.name, "PSM1", EVENTS, {}, {})
    writer = directory.writer(world.name, "PSM1", "events", "arm")
    reader = directory.reader(world.name, "PSM1", "events", "arm")
    yield Events(writer, lambda: 5000), reader
    writer.close()
    reader.close()
    world.remove()


def test_stamps_increase_even_when_the_clock_stands(ends: tuple[Events, RingReader]) -> None:
    events, reader = ends
    for _ in range(5):
        events.status("hello")
    assert reader.last(9)["stamp_ns"].tolist() == [5000, 5001, 5002, 5003, 5004]


def test_stamps_increase_over_a_restart(world: Any, ends: tuple[Events, RingReader]) -> None:
    events, reader = ends
    events.status("one")
    events._ring.close()
    heir = directory.writer(world.name, "PSM1", "events", "arm")
    Events(heir, lambda: 10).status("two")
    assert reader.last(9)["stamp_ns"].tolist() == [5000, 5001]
    heir.close()


def test_every_field_of_an_event_is_its_own(ends: tuple[Events, RingReader]) -> None:
    events, reader = ends
    events.report(codes.TRACKING, "too far", component="PSM1", axis=2, value=0.3, limit=0.25)
    events.status("fine")
    first, second = reader.last(2)
    assert (first["event"], first["severity"], first["code"], first["component"], first["axis"]) == (
        b"error", ERROR, b"tracking", b"PSM1", 2)
    assert (first["value"], first["limit"]) == (0.3, 0.25)
    assert (second["severity"], second["code"], second["component"], second["axis"]) == (STATUS, b"", b"", -1)
    assert math.isnan(second["value"]) and math.isnan(second["limit"])


def test_states_and_goals_are_events(ends: tuple[Events, RingReader]) -> None:
    events, reader = ends
    events.operating_state("ENABLED", "HOMED", True, False)
    events.goal_reached(False)
    events.report(codes.CLIPPED, "at the limit")
    state, goal, warning = reader.last(3)
    assert (state["state"], state["sub_state"], bool(state["is_homed"]), bool(state["is_busy"])) == (
        b"ENABLED", b"HOMED", True, False)
    assert (goal["event"], goal["value"], bool(goal["is_homed"])) == (b"goal_reached", 0.0, False)
    assert (warning["severity"], warning["state"]) == (WARNING, b"")


def test_texts_are_cut_not_refused(ends: tuple[Events, RingReader]) -> None:
    events, reader = ends
    events.emit("e" * 99, "ü" * 500, code="c" * 99, component="d" * 99, state="s" * 99, sub_state="t" * 99)
    (record,) = reader.last(1)
    assert record["text"].decode() == "ü" * 198 + "…"
    assert [len(record[n]) for n in ("event", "code", "component", "state", "sub_state")] == [32, 32, 24, 16, 40]


def test_a_long_sentence_ends_with_a_whole_word_and_the_log_has_the_rest(ends: tuple[Events, RingReader]) -> None:
    logged: list[tuple[int, str]] = []
    _, reader = ends
    events = Events(ends[0]._ring, lambda: 5000, lambda severity, text: logged.append((severity, text)))
    text = "PSM1: " + "blocked joint " * 40 + "end"
    events.report(codes.TRACKING, text, "PSM1")
    events.status("HOMED", "PSM1")
    record = reader.last(2)[0]
    assert record["text"].decode().endswith(("blocked…", "joint…")) and len(record["text"]) <= 400
    assert sorted(logged) == [(STATUS, "PSM1: HOMED"), (ERROR, f"{text}; {codes.TRACKING.remedy_for('PSM1')}")]


def test_a_sentence_names_once_whom_it_is_about(ends: tuple[Events, RingReader]) -> None:
    events, reader = ends
    for text in ("too hot", "PSM1: too hot", "PSM1 axis 2, board 6: too hot"):
        events.report(codes.TEMPERATURE_HIGH, text, "PSM1")
    assert [text.decode() for text in reader.last(3)["text"]] == [
        "PSM1: too hot", "PSM1: too hot", "PSM1 axis 2, board 6: too hot"]


def test_an_event_says_when_by_both_clocks(ends: tuple[Events, RingReader]) -> None:
    events, reader = ends
    before = monotonic_ns(), local_ns()
    events.status("now")
    after = monotonic_ns(), local_ns()
    (record,) = reader.last(1)
    assert before[0] <= record["monotonic_ns"] <= after[0] and before[1] <= record["local_ns"] <= after[1]


def test_a_late_comer_sees_the_last_events(world: Any, ends: tuple[Events, RingReader]) -> None:
    events, _ = ends
    for i in range(3):
        events.status(f"event {i}")
    late = directory.reader(world.name, "PSM1", "events")
    assert late.last(2)["text"].tolist() == [b"event 1", b"event 2"]
    late.close()


def test_a_remedy_names_whom_it_is_about(ends: tuple[Events, RingReader]) -> None:
    writer, reader = ends
    events = Events(writer._ring, lambda: 5000, name="io")
    events.report(codes.ARM_LOST, "no setpoints", "PSM1")
    events.report(codes.ARM_LOST, "no setpoints")
    about, own = reader.last(2)["hint"]
    assert "trocar start PSM1" in about.decode() and "trocar start io" in own.decode()
    assert [row.code for row in codes.CODES if "NAME" in row.remedy_for("PSM1")] == []
