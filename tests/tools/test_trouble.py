"""Rings and pages in trouble, as a person sees them: dead writers, torn records, spoilt headers."""

from __future__ import annotations

import dataclasses
import itertools
import json
import os
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner, Result

from shm import directory
from shm.clock import monotonic_ns
from shm.ring import HEAD, RingReader, RingWriter
from shm.segment import Segment, path_of, segment_name, unlink
from shm.topics import SETPOINT
from tests.tools.robot import Played, nothing_ages, robot
from tools import cli
from tools.bench import io_loop as bench_io
from tools.errors import Problem
from tools.examples.operator_sim import SeenRecord
from tools.inspect.processes import cells, lives, remarks
from tools.inspect.topics import catalogue
from tools.inspect.views import open_topic
from tools.inspect.watch import arm_document
from tools.verbs.echo import _said

APP = cli.build()
SETPOINT_LIKE = dataclasses.replace(SETPOINT, name="state")


@pytest.fixture
def played(world: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[Played]:
    monkeypatch.setattr("tools.verbs.listing.pause", lambda seconds: None)  # no figure here depends on time
    monkeypatch.setattr("tools.inspect.processes.pause", lambda seconds: None)
    nothing_ages(monkeypatch)
    with robot(world.name) as made:
        yield made


def run(played: Played, *words: str) -> Result:
    return CliRunner().invoke(APP, [*words, "--system", played.name])


def rows(result: Result) -> dict[str, dict[str, Any]]:
    return {row["topic"]: row for row in map(json.loads, result.stdout.splitlines())}


def gone() -> str:
    return f"its writer PSM1 (pid {os.getpid()}) is gone"


def tear(played: Played, instance: str = "PSM1") -> None:
    """The newest state is half written: garbage in a slot that somebody is at."""
    with Segment(segment_name(played.name, instance, "state"), write=True) as hand:
        words, header = hand.words(), hand.header
        at = header.first + words[HEAD] % header.depth * header.stride
        hand.view[at + 8 : at + header.stride] = b"\xc7" * (header.stride - 8)
        words[at // 8] = 0


def spoil(played: Played, ring: str = "PSM1/state") -> None:
    """The header of a ring makes no sense."""
    with path_of(segment_name(played.name, *ring.split("/"))).open("r+b") as file:
        file.seek(16)
        file.write(b"\xff" * 8)


def test_all_is_well_and_said_so(played: Played) -> None:
    played.show_arm()
    listed = rows(run(played, "list", "--json"))
    assert {row["trouble"] for row in listed.values()} == {""}
    measured = rows(run(played, "hz", "--window", "0.05", "--json"))
    assert {row["trouble"] for row in measured.values()} == {""}
    once = json.loads(run(played, "echo", "PSM1/state", "--once", "--json").stdout)
    assert "trouble" not in once
    assert "trouble:" not in run(played, "echo", "PSM1/state", "--once").stdout


def test_a_dead_writer_is_named_by_every_verb(played: Played) -> None:
    played.show_arm(0.25)
    played.arm.close()
    listed = rows(run(played, "list", "--json"))
    assert listed["PSM1/state"]["trouble"] == listed["PSM1/measured_js"]["trouble"] == gone()
    assert listed["IO1/state"]["trouble"] == listed["PSM1/error"]["trouble"] == ""
    assert gone() in " ".join(run(played, "list").stdout.split())
    assert f"PSM1/state  (record, nominal 1500 Hz)  {gone()}" in run(played, "list", "--verbose").stdout
    measured = run(played, "hz", "PSM1/state", "--window", "0.05", "--json")
    assert measured.exit_code == 1 and rows(measured)["PSM1/state"]["trouble"] == gone()
    assert gone() in " ".join(run(played, "hz", "--window", "0.05").stdout.split())
    row = json.loads(run(played, "echo", "PSM1/measured_js", "--once", "--json").stdout)
    assert (row["position"][0], row["trouble"]) == (0.25, gone())
    assert f"trouble: {gone()}" in run(played, "echo", "PSM1/measured_js", "--once").stdout
    assert gone() in " ".join(run(played, "attach", "--once").stdout.split())


def test_what_a_dead_arm_last_said_is_not_taken_for_its_state(played: Played) -> None:
    played.show_arm(state="ENABLED", homed=True)
    assert run(played, "home", "--timeout", "0.1").exit_code == 0
    played.arm.close()
    result = run(played, "home", "--timeout", "0.1", "--json")
    assert result.exit_code == 1
    assert json.loads(result.stdout)["problem"] == f"not homed in time; {gone()}"


def test_an_arm_whose_record_is_torn_is_not_seen(played: Played) -> None:
    played.show_arm(state="ENABLED", homed=True)
    tear(played)
    result = run(played, "home", "--timeout", "0.1", "--json")
    assert result.exit_code == 1
    assert "reads found no whole record" in json.loads(result.stdout)["problem"]


def test_a_ring_nobody_wrote_yet_has_no_dead_writer(played: Played) -> None:
    listed = rows(run(played, "list", "--json"))
    assert listed["PSM1/setpoint"]["trouble"] == ""  # the played arm never claims it


def test_torn_records_are_told(played: Played) -> None:
    played.show_arm()
    tear(played)
    measured = rows(run(played, "hz", "--window", "0.05", "--json"))
    assert measured["PSM1/state"]["trouble"] == "1 reads found no whole record"
    failed = run(played, "echo", "PSM1/state", "--once", "--timeout", "0")
    assert failed.exit_code == 1
    assert "PSM1/state: no record is whole (1 reads found no whole record)" in failed.stderr
    page = " ".join(run(played, "attach", "--once").stdout.split())
    assert "1 reads found no whole record" in page


def test_the_demo_takes_no_torn_record_for_its_arm(played: Played) -> None:
    seen = SeenRecord(played.name, "PSM1", "arm")
    with pytest.raises(Problem, match=r"PSM1: its state cannot be read: it has shown none"):
        seen.value("state")
    played.show_arm(state="ENABLED", homed=True)
    assert seen.value("state") == "ENABLED"
    tear(played)
    with pytest.raises(Problem, match=r"PSM1: its state cannot be read: 1 reads found no whole record"):
        seen.value("state")
    seen.ring.close()


def test_the_bench_of_io_takes_every_record_once(played: Played, monkeypatch: pytest.MonkeyPatch) -> None:
    stamps, since = itertools.count(1_000_000_000, 1_000_000), RingReader.since

    def publish(*_: object) -> None:
        for _ in range(5):
            played.io.field("cycle")[...] += 1
            played.io.field("valid")[...] = True
            played.io.field("write_ns")[...] = 1000 * (played.io.sequence % 2)
            played.io.publish(next(stamps))

    def disturbed(self: RingReader, stamp_ns: int) -> Any:
        rows = since(self, stamp_ns)
        publish()  # io does not wait for whoever looks
        return rows

    publish()
    monkeypatch.setattr(RingReader, "since", disturbed)
    monkeypatch.setattr(bench_io, "pause", publish)
    monkeypatch.setattr(bench_io, "monotonic_ns", itertools.count().__next__)
    figures = bench_io._watch(played.name, 9e-9)  # eight looks
    assert figures["cycles"] == 80 and figures["rate_hz"] == pytest.approx(1000.0)
    assert figures["period_us_p50"] == figures["period_us_p99"] == 1000.0


@pytest.mark.parametrize("first", [True, False])
def test_the_bench_of_io_takes_no_torn_record(played: Played, first: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    def publish(*_: object) -> None:
        played.io.field("valid")[...] = True
        played.io.publish(monotonic_ns())

    def torn(*_: object) -> None:
        publish()
        tear(played, "IO1")

    (torn if first else publish)()
    steps = iter((publish, publish if first else torn))
    monkeypatch.setattr(bench_io, "pause", lambda seconds: next(steps)())
    monkeypatch.setattr(bench_io, "monotonic_ns", itertools.count().__next__)
    with pytest.raises(Problem, match=r"io's state cannot be read: \d reads found no whole record"):
        bench_io._watch(played.name, 3e-9)


def test_a_head_that_goes_backwards_is_told(played: Played, monkeypatch: pytest.MonkeyPatch) -> None:
    def meanwhile(seconds: float) -> None:
        with Segment(segment_name(played.name, "PSM1", "state"), write=True) as hand:
            hand.words()[HEAD] = 1

    for _ in range(5):
        played.show_arm()
    monkeypatch.setattr("tools.verbs.listing.pause", meanwhile)
    row = rows(run(played, "hz", "PSM1/state", "--json"))["PSM1/state"]
    assert (row["trouble"], row["records"], row["hz"]) == ("the head went backwards", 0, 0.0)


def test_records_that_were_missed_are_told(played: Played) -> None:
    with open_topic(played.name, "PSM1/state") as source:
        for _ in range(5000):
            played.arm.publish(monotonic_ns())
        assert source.next() and source.lost > 0 and source.trouble() == ""
        assert _said(source) == f"{source.lost} records were overwritten before they were read"


def test_one_spoilt_ring_leaves_the_others_readable(played: Played) -> None:
    played.show_arm()
    played.io.publish(monotonic_ns())
    spoil(played)
    listed = run(played, "list", "--json")
    assert listed.exit_code == 0
    assert "contradict each other" in rows(listed)["PSM1/state"]["trouble"]
    assert rows(listed)["IO1/PSM1/measured_js"]["trouble"] == ""
    measured = rows(run(played, "hz", "--window", "0.05", "--json"))
    assert "contradict each other" in measured["PSM1/state"]["trouble"] and measured["PSM1/state"]["hz"] == 0.0
    assert measured["IO1/state"]["trouble"] == ""
    assert json.loads(run(played, "echo", "IO1/state", "--once", "--json").stdout)["sequence"] == 1
    refused = run(played, "echo", "PSM1/state", "--once")
    assert refused.exit_code == 1 and "contradict each other" in refused.stderr
    assert len(json.loads(run(played, "status", "--json").stdout)["processes"]) == 3
    page = run(played, "attach", "--once")
    assert page.exit_code == 0 and "contradict" in page.stdout


@pytest.mark.parametrize("ring", ["PSM1/events", "IO1/state", "IO1/events", "supervisor/state"])
def test_verbs_that_do_not_need_it_do_without_a_spoilt_ring(played: Played, ring: str) -> None:
    played.show_arm(state="ENABLED", homed=True)
    spoil(played, ring)
    assert run(played, "attach", "--once").exit_code == 0
    assert run(played, "list").exit_code == 0
    if ring != "PSM1/events":
        played.show_arm(state="ENABLED", homed=True)
        assert run(played, "home", "--timeout", "0.1").exit_code == 0


def test_a_ledger_of_another_version_takes_nothing_from_status(played: Played) -> None:
    name = segment_name(played.name, "supervisor", "state")
    played.supervisor.close()
    unlink(name)
    directory.create_ring(played.name, "supervisor", SETPOINT_LIKE, {}, {"dims": {"instances": 2}})
    writer = RingWriter(Segment(name, write=True), "supervisor")
    writer.publish(1)
    writer.close()
    status = json.loads(run(played, "status", "--json").stdout)
    assert {row["name"] for row in status["processes"]} == {"supervisor", "IO1", "PSM1"}


@pytest.mark.parametrize("text", [b"", b"[]", b'{"name":3}', b'{"arms":[7]}', b"\xff", b'{"colour":1}'])
def test_a_document_that_is_none_is_a_problem(played: Played, text: bytes) -> None:
    unlink(segment_name(played.name, "supervisor", "document"))
    directory.publish_document(played.name, text)
    said = f"system {played.name}: (the document is not readable: |PSM1: not in this system)"
    with pytest.raises(Problem, match=said):
        arm_document(played.name, "PSM1")


def test_a_spoilt_ledger_takes_nothing_from_status(played: Played) -> None:
    spoil(played, "supervisor/state")
    status = json.loads(run(played, "status", "--json").stdout)
    assert {row["name"] for row in status["processes"]} == {"supervisor", "IO1", "PSM1"}


@pytest.mark.slow
@pytest.mark.parametrize("info", [
    {"rate_hz": "often"}, {"rate_hz": [1]}, {"kind": "io", "robots": 3}, {"kind": "io", "robots": {"PSM1": 7}},
    {"kind": "io", "robots": {"PSM1": {"first": 0}}}, {"kind": "io", "robots": {"PSM1": {"first": "x", "count": 1}}},
    {"kind": "io", "robots": ["PSM1"]}, {"kind": ["arm"]}, {},
])
def test_a_header_may_say_anything_of_its_instance(played: Played, info: dict[str, Any]) -> None:
    played.show_arm()
    name = segment_name(played.name, "IO1", "state")
    path = path_of(name)
    raw = bytearray(path.read_bytes())
    length = int.from_bytes(raw[32:36], "little")
    text = json.dumps(info).encode()
    raw[36:40] = len(text).to_bytes(4, "little")
    raw[256 + length : 256 + length + len(text)] = text
    path.write_bytes(raw[: len(raw)])
    listed = run(played, "list", "--json")
    assert listed.exit_code == 0, listed.output
    assert "PSM1/measured_js" in rows(listed) and "IO1/state" in rows(listed)
    assert run(played, "hz", "--window", "0.05", "--json").exit_code == 0
    assert run(played, "attach", "--once").exit_code == 0


def test_status_says_how_often_a_process_was_held_up(played: Played) -> None:
    played.pages["PSM1"].field("pauses")[...] = 3
    life = next(life for life in lives(played.name) if life.name == "PSM1")
    assert life.pauses == 3 and "held up 3 times" in remarks(life)


@settings(deadline=None, max_examples=30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(at=st.integers(0, 1000), data=st.binary(min_size=1, max_size=1000))
def test_status_survives_a_scribbled_control_page(played: Played, at: int, data: bytes) -> None:
    control_page = played.pages["PSM1"]
    view, first = control_page.segment.view, control_page.segment.header.first
    good = view[first:].tobytes()
    end = min(len(view), first + at + len(data))
    view[first + at : end] = data[: end - first - at]
    found = {life.name: life for life in lives(played.name)}
    assert set(found) == {"supervisor", "IO1", "PSM1"}
    assert all(isinstance(cell, str) for cell in cells(found["PSM1"])) and isinstance(remarks(found["PSM1"]), str)
    view[first:] = good


def test_status_says_that_a_process_is_dead(played: Played) -> None:
    played.beat()
    played.pages["PSM1"].segment.view[64:68] = (2**22 + 1).to_bytes(4, "little")  # no such process
    status = json.loads(run(played, "status", "--json").stdout)
    assert next(row["trouble"] for row in status["processes"] if row["name"] == "PSM1") == "dead"


def test_the_catalogue_asks_without_disturbing_a_writer(played: Played) -> None:
    for _ in range(3):
        assert not any(entry.trouble for entry in catalogue(played.name))
    played.show_arm()
    assert played.arm.sequence == 1
