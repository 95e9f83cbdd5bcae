"""Rings and pages in problem, as a person sees them: dead writers, torn records, spoilt headers."""

from __future__ import annotations

import dataclasses
import itertools
import json
import os
from collections.abc import Iterator
from typing import Any

import pytest
from hypothesis import HealthCheck, given
from hypothesis import strategies as st
from typer.testing import CliRunner, Result

from tests.examples import examples
from tests.tools.robot import ScriptedRobot, nothing_ages, robot
from trocar.procs.crtk.topics import find
from trocar.procs.crtk.views import OpenTopic
from trocar.shm.memory.segment import Segment, path_of, segment_name, unlink
from trocar.shm.ring.ring import HEAD, RingReader, RingWriter
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.topics import SETPOINT
from trocar.tools import cli
from trocar.tools.bench import io_loop as bench_io
from trocar.tools.examples.operator_sim import SeenRecord
from trocar.tools.inspect.processes import cells, remarks, statuses
from trocar.tools.inspect.watch import arm_document
from trocar.tools.output.errors import Problem
from trocar.tools.verbs.echo import _reported

APP = cli.build()
SETPOINT_LIKE = dataclasses.replace(SETPOINT, name="state")


@pytest.fixture
def kinematic(world: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[ScriptedRobot]:
    monkeypatch.setattr("trocar.tools.verbs.listing.pause", lambda seconds: None)  # no figure here depends on time
    monkeypatch.setattr("trocar.tools.inspect.processes.pause", lambda seconds: None)
    nothing_ages(monkeypatch)
    with robot(world.name) as made:
        yield made


def run(kinematic: ScriptedRobot, *words: str) -> Result:
    return CliRunner().invoke(APP, [*words, "--system", kinematic.name])


def rows(result: Result) -> dict[str, dict[str, Any]]:
    return {row["topic"]: row for row in map(json.loads, result.stdout.splitlines())}


def gone() -> str:
    return f"its writer PSM1 (pid {os.getpid()}) is gone"


def tear(kinematic: ScriptedRobot, instance: str = "PSM1") -> None:
    """The newest state is half written: garbage in a slot that somebody is at."""
    with Segment(segment_name(kinematic.name, instance, "state"), write=True) as hand:
        words, header = hand.words(), hand.header
        at = header.first + words[HEAD] % header.depth * header.stride
        hand.view[at + 8 : at + header.stride] = b"\xc7" * (header.stride - 8)
        words[at // 8] = 0


def spoil(kinematic: ScriptedRobot, ring: str = "PSM1/state") -> None:
    """The header of a ring makes no sense."""
    with path_of(segment_name(kinematic.name, *ring.split("/"))).open("r+b") as file:
        file.seek(16)
        file.write(b"\xff" * 8)


def test_all_is_well_and_said_so(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm()
    listed = rows(run(kinematic, "list", "--json"))
    assert {row["problem"] for row in listed.values()} == {""}
    measured = rows(run(kinematic, "hz", "--window", "0.05", "--json"))
    assert {row["problem"] for row in measured.values()} == {""}
    once = json.loads(run(kinematic, "echo", "PSM1/state", "--once", "--json").stdout)
    assert "problem" not in once
    assert "problem:" not in run(kinematic, "echo", "PSM1/state", "--once").stdout


def test_a_dead_writer_is_named_by_every_verb(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(0.25)
    kinematic.arm.close()
    listed = rows(run(kinematic, "list", "--json"))
    assert listed["PSM1/state"]["problem"] == listed["PSM1/measured_js"]["problem"] == gone()
    assert listed["IO1/state"]["problem"] == listed["PSM1/error"]["problem"] == ""
    assert gone() in " ".join(run(kinematic, "list").stdout.split())
    assert f"PSM1/state  (record, nominal 1500 Hz)  {gone()}" in run(kinematic, "list", "--verbose").stdout
    measured = run(kinematic, "hz", "PSM1/state", "--window", "0.05", "--json")
    assert measured.exit_code == 1 and rows(measured)["PSM1/state"]["problem"] == gone()
    assert gone() in " ".join(run(kinematic, "hz", "--window", "0.05").stdout.split())
    row = json.loads(run(kinematic, "echo", "PSM1/measured_js", "--once", "--json").stdout)
    assert (row["position"][0], row["problem"]) == (0.25, gone())
    assert f"problem: {gone()}" in run(kinematic, "echo", "PSM1/measured_js", "--once").stdout
    assert gone() in " ".join(run(kinematic, "attach", "--once").stdout.split())


def test_what_a_dead_arm_last_said_is_not_taken_for_its_state(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(state="ENABLED", homed=True)
    assert run(kinematic, "home", "--timeout", "0.1").exit_code == 0
    kinematic.arm.close()
    result = run(kinematic, "home", "--timeout", "0.1", "--json")
    assert result.exit_code == 1
    assert json.loads(result.stdout)["problem"] == f"not homed in time; {gone()}"


def test_an_arm_whose_record_is_torn_is_not_seen(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm(state="ENABLED", homed=True)
    tear(kinematic)
    result = run(kinematic, "home", "--timeout", "0.1", "--json")
    assert result.exit_code == 1
    assert "reads found no whole record" in json.loads(result.stdout)["problem"]


def test_torn_records_are_told(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm()
    tear(kinematic)
    measured = rows(run(kinematic, "hz", "--window", "0.05", "--json"))
    assert measured["PSM1/state"]["problem"] == "2 reads found no whole record", "the one with which it came, too"
    failed = run(kinematic, "echo", "PSM1/state", "--once", "--timeout", "0")
    assert failed.exit_code == 1
    assert "PSM1/state: no record is whole (2 reads found no whole record)" in failed.stderr
    page = " ".join(run(kinematic, "attach", "--once").stdout.split())
    assert "no record is whole" in page


def test_the_demo_takes_no_torn_record_for_its_arm(kinematic: ScriptedRobot) -> None:
    seen = SeenRecord(kinematic.name, "PSM1", "arm")
    with pytest.raises(Problem, match=r"PSM1: its state cannot be read: it has shown none"):
        seen.value("state")
    kinematic.show_arm(state="ENABLED", homed=True)
    assert seen.value("state") == "ENABLED"
    tear(kinematic)
    with pytest.raises(Problem, match=r"PSM1: its state cannot be read: 1 reads found no whole record"):
        seen.value("state")
    seen.ring.close()


def test_the_bench_of_io_takes_every_record_once(kinematic: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    stamps, since = itertools.count(1_000_000_000, 1_000_000), RingReader.since

    def publish(*_: object) -> None:
        for _ in range(5):
            kinematic.io.field("cycle")[...] += 1
            kinematic.io.field("valid")[...] = True
            kinematic.io.field("write_ns")[...] = 1000 * (kinematic.io.sequence % 2)
            kinematic.io.publish(next(stamps))

    def disturbed(self: RingReader, stamp_ns: int) -> Any:
        rows = since(self, stamp_ns)
        publish()  # io does not wait for whoever looks
        return rows

    publish()
    monkeypatch.setattr(RingReader, "since", disturbed)
    monkeypatch.setattr(bench_io, "pause", publish)
    monkeypatch.setattr(bench_io, "monotonic_ns", itertools.count().__next__)
    figures = bench_io._watch(kinematic.name, 9e-9)  # eight looks
    assert figures["cycles"] == 80 and figures["rate_hz"] == pytest.approx(1000.0)
    assert figures["period_us_p50"] == figures["period_us_p99"] == 1000.0


@pytest.mark.parametrize("first", [True, False])
def test_the_bench_of_io_takes_no_torn_record(kinematic: ScriptedRobot, first: bool,
                                              monkeypatch: pytest.MonkeyPatch) -> None:
    def publish(*_: object) -> None:
        kinematic.io.field("valid")[...] = True
        kinematic.io.publish(monotonic_ns())

    def torn(*_: object) -> None:
        publish()
        tear(kinematic, "IO1")

    (torn if first else publish)()
    steps = iter((publish, publish if first else torn))
    monkeypatch.setattr(bench_io, "pause", lambda seconds: next(steps)())
    monkeypatch.setattr(bench_io, "monotonic_ns", itertools.count().__next__)
    with pytest.raises(Problem, match=r"io's state cannot be read: \d reads found no whole record"):
        bench_io._watch(kinematic.name, 3e-9)


def test_the_bench_of_io_tells_that_io_began_anew(kinematic: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    def publish(*_: object) -> None:
        kinematic.io.field("valid")[...] = True
        kinematic.io.publish(monotonic_ns())

    def died(*_: object) -> None:
        kinematic.io.close()
        kinematic.io = directory.writer(kinematic.name, "IO1", "state", "io")
        publish()

    publish()
    monkeypatch.setattr(bench_io, "pause", died)
    monkeypatch.setattr(bench_io, "monotonic_ns", itertools.count().__next__)
    with pytest.raises(Problem, match="io stalled and restarted during the measurement"):
        bench_io._watch(kinematic.name, 3e-9)


def test_a_head_that_goes_backwards_is_told(kinematic: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    def meanwhile(seconds: float) -> None:
        with Segment(segment_name(kinematic.name, "PSM1", "state"), write=True) as hand:
            hand.words()[HEAD] = 1

    for _ in range(5):
        kinematic.show_arm()
    monkeypatch.setattr("trocar.tools.verbs.listing.pause", meanwhile)
    row = rows(run(kinematic, "hz", "PSM1/state", "--json"))["PSM1/state"]
    assert (row["problem"], row["records"], row["hz"]) == ("the head went backwards", 0, 0.0)


def test_records_that_were_missed_are_told(kinematic: ScriptedRobot) -> None:
    with OpenTopic(kinematic.name, find(kinematic.name, "PSM1/state")) as source:
        for _ in range(5000):
            kinematic.arm.publish(monotonic_ns())
        assert source.next() and source.lost > 0 and source.problem() == ""
        assert _reported(source) == f"{source.lost} records were overwritten before they were read"


def test_one_spoilt_ring_leaves_the_others_readable(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm()
    kinematic.io.publish(monotonic_ns())
    spoil(kinematic)
    listed = run(kinematic, "list", "--json")
    assert listed.exit_code == 0
    assert "contradict each other" in rows(listed)["PSM1/state"]["problem"]
    assert rows(listed)["IO1/PSM1/measured_js"]["problem"] == ""
    measured = rows(run(kinematic, "hz", "--window", "0.05", "--json"))
    assert "contradict each other" in measured["PSM1/state"]["problem"] and measured["PSM1/state"]["hz"] == 0.0
    assert measured["IO1/state"]["problem"] == ""
    assert json.loads(run(kinematic, "echo", "IO1/state", "--once", "--json").stdout)["sequence"] == 1
    refused = run(kinematic, "echo", "PSM1/state", "--once")
    assert refused.exit_code == 1 and "contradict each other" in refused.stderr
    assert len(json.loads(run(kinematic, "status", "--json").stdout)["processes"]) == 3
    page = run(kinematic, "attach", "--once")
    assert page.exit_code == 0 and "contradict" in page.stdout


@pytest.mark.parametrize("ring", ["PSM1/events", "IO1/state", "IO1/events", "supervisor/state"])
def test_verbs_that_do_not_need_it_do_without_a_spoilt_ring(kinematic: ScriptedRobot, ring: str) -> None:
    kinematic.show_arm(state="ENABLED", homed=True)
    spoil(kinematic, ring)
    assert run(kinematic, "attach", "--once").exit_code == 0
    assert run(kinematic, "list").exit_code == 0
    if ring != "PSM1/events":
        kinematic.show_arm(state="ENABLED", homed=True)
        assert run(kinematic, "home", "--timeout", "0.1").exit_code == 0


def test_a_ledger_of_another_version_takes_nothing_from_status(kinematic: ScriptedRobot) -> None:
    name = segment_name(kinematic.name, "supervisor", "state")
    kinematic.supervisor.close()
    unlink(name)
    directory.create_ring(kinematic.name, "supervisor", SETPOINT_LIKE, {}, {"dims": {"instances": 2}})
    writer = RingWriter(Segment(name, write=True), "supervisor")
    writer.publish(1)
    writer.close()
    status = json.loads(run(kinematic, "status", "--json").stdout)
    assert {row["name"] for row in status["processes"]} == {"supervisor", "IO1", "PSM1"}


@pytest.mark.parametrize("text", [b"", b"[]", b'{"name":3}', b'{"arms":[7]}', b"\xff", b'{"colour":1}'])
def test_a_document_that_is_none_is_a_problem(kinematic: ScriptedRobot, text: bytes) -> None:
    unlink(segment_name(kinematic.name, "supervisor", "document"))
    directory.publish_document(kinematic.name, text)
    reported = f"system {kinematic.name}: (the document is not readable: |PSM1: not in this system)"
    with pytest.raises(Problem, match=reported):
        arm_document(kinematic.name, "PSM1")


def test_a_spoilt_ledger_takes_nothing_from_status(kinematic: ScriptedRobot) -> None:
    spoil(kinematic, "supervisor/state")
    status = json.loads(run(kinematic, "status", "--json").stdout)
    assert {row["name"] for row in status["processes"]} == {"supervisor", "IO1", "PSM1"}


@pytest.mark.slow
@pytest.mark.parametrize("info", [
    {"rate_hz": "often"}, {"rate_hz": [1]}, {"kind": "io", "robots": 3}, {"kind": "io", "robots": {"PSM1": 7}},
    {"kind": "io", "robots": {"PSM1": {"first": 0}}}, {"kind": "io", "robots": {"PSM1": {"first": "x", "count": 1}}},
    {"kind": "io", "robots": ["PSM1"]}, {"kind": ["arm"]}, {},
])
def test_a_header_may_say_anything_of_its_instance(kinematic: ScriptedRobot, info: dict[str, Any]) -> None:
    kinematic.show_arm()
    name = segment_name(kinematic.name, "IO1", "state")
    path = path_of(name)
    raw = bytearray(path.read_bytes())
    length = int.from_bytes(raw[32:36], "little")
    text = json.dumps(info).encode()
    raw[36:40] = len(text).to_bytes(4, "little")
    raw[256 + length : 256 + length + len(text)] = text
    path.write_bytes(raw[: len(raw)])
    listed = run(kinematic, "list", "--json")
    assert listed.exit_code == 0, listed.output
    assert "PSM1/measured_js" in rows(listed) and "IO1/state" in rows(listed)
    assert run(kinematic, "hz", "--window", "0.05", "--json").exit_code == 0
    assert run(kinematic, "attach", "--once").exit_code == 0


def test_status_says_how_often_a_process_stalled(kinematic: ScriptedRobot) -> None:
    kinematic.pages["PSM1"].field("pauses")[...] = 3
    process = next(process for process in statuses(kinematic.name) if process.name == "PSM1")
    assert process.pauses == 3 and "stalled 3 times" in remarks(process)


@pytest.mark.parametrize("computes", [b"native", b"numpy: it is not compiled"])
def test_status_says_which_processes_compute_on_numpy_and_why(kinematic: ScriptedRobot, computes: bytes) -> None:
    kinematic.pages["PSM1"].field("computes")[...] = computes
    process = next(process for process in statuses(kinematic.name) if process.name == "PSM1")
    assert process.computes == computes.decode() and ("numpy: " in remarks(process)) == (computes != b"native")


@examples(30, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(at=st.integers(0, 1000), data=st.binary(min_size=1, max_size=1000))
def test_status_survives_a_scribbled_control_page(kinematic: ScriptedRobot, at: int, data: bytes) -> None:
    control_page = kinematic.pages["PSM1"]
    view, first = control_page.segment.view, control_page.segment.header.first
    good = view[first:].tobytes()
    end = min(len(view), first + at + len(data))
    view[first + at : end] = data[: end - first - at]
    found = {process.name: process for process in statuses(kinematic.name)}
    assert set(found) == {"supervisor", "IO1", "PSM1"}
    assert all(isinstance(cell, str) for cell in cells(found["PSM1"])) and isinstance(remarks(found["PSM1"]), str)
    view[first:] = good


def test_status_says_that_a_process_is_dead(kinematic: ScriptedRobot) -> None:
    kinematic.beat()
    kinematic.pages["PSM1"].segment.view[64:68] = (2**22 + 1).to_bytes(4, "little")  # no such process
    status = json.loads(run(kinematic, "status", "--json").stdout)
    assert next(row["problem"] for row in status["processes"] if row["name"] == "PSM1") == "dead"
