"""What `trocar attach` reads, without a terminal: on a system that the test plays."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from tests.conftest import World
from tests.tools.robot import ScriptedRobot, robot
from trocar.procs.crtk.topics import find
from trocar.procs.tables import codes
from trocar.shm.memory.segment import Segment, segment_name
from trocar.shm.ring.stamps import head_of, newest_stamps
from trocar.shm.system import directory
from trocar.shm.system.subscriptions import Subscriptions
from trocar.shm.time.clock import monotonic_ns
from trocar.tools import cli
from trocar.tools.inspect.processes import ProcessStatus, statuses
from trocar.tools.monitor import events, overview, processes
from trocar.tools.monitor.events import AskedRow, under_way
from trocar.tools.monitor.overview import identity_of
from trocar.tools.monitor.topics import TopicsData
from trocar.tools.monitor.values import ValuesData, shown_value

APP = cli.build()


@pytest.fixture
def played(world: World) -> Iterator[ScriptedRobot]:
    with robot(world.name) as made:
        made.show_arm(0.25)
        yield made


def run(played: ScriptedRobot, *words: str) -> Result:
    return CliRunner().invoke(APP, [*words, "--system", played.name])


# what stands above


@pytest.mark.slow
def test_a_dead_supervisor_is_told_with_the_time_since(played: ScriptedRobot) -> None:
    seen = overview.overview(played.name)
    assert seen.lives and seen.words == "supervisor runs"
    played.pages["supervisor"].field("heartbeat_ns")[...] = monotonic_ns() - 12_000_000_000
    played.pages["supervisor"].segment.view[64:68] = (1 << 22).to_bytes(4, "little")  # nobody has this pid
    seen = overview.overview(played.name)
    assert not seen.lives and re.fullmatch(r"supervisor dead for 1\d s: left in shared memory", seen.words)
    assert seen.first.startswith("first: supervisor is dead: trocar up")


def test_a_stalled_supervisor_is_told_with_the_time_since(played: ScriptedRobot) -> None:
    played.pages["supervisor"].field("heartbeat_ns")[...] = monotonic_ns() - 12_000_000_000
    assert re.fullmatch(r"supervisor stalled for 1\d s", overview.overview(played.name).words)
    stalled = run(played, "attach", "--once").stdout.splitlines()[0]
    assert re.search("supervisor stalled for 1. s", stalled) and "supervisor runs" not in stalled


def test_a_system_that_is_gone_is_waited_for(world: World) -> None:
    seen = overview.overview(world.name)
    assert seen.supervisor == "gone" and "waiting until it is up again" in seen.words and not identity_of(world.name)


def test_another_system_of_the_same_name_is_another(world: World) -> None:
    with robot(world.name):
        first = identity_of(world.name)
        assert first == identity_of(world.name) != ()
    assert identity_of(world.name) == ()


# pages


def test_processes_show_what_they_use_and_how_long_they_are_silent(played: ScriptedRobot) -> None:
    data = processes.ProcessesData()
    data.rows(statuses(played.name))
    rows = {row.status.name: row for row in data.rows(statuses(played.name))}
    assert rows["PSM1"].memory_mb is not None and rows["PSM1"].memory_mb > 10.0 and not rows["PSM1"].is_gone
    played.restarted(3, "killed by signal 9")
    assert "killed by signal 9" in processes.process_cells(data.rows(statuses(played.name))[2])
    dead = dataclasses.replace(rows["PSM1"].status, problem="dead", silent_s=12.3)
    row = data.rows([dead])[0]
    assert row.state == "dead 12 s" and row.is_gone and row.cpu_percent is None and "problem: dead" in row.details()


def test_topics_show_nominal_and_real_rate_and_age(played: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("trocar.tools.monitor.topics.WINDOW_NS", 60_000_000_000)
    stamp = monotonic_ns() + 10_000_000_000  # not old, however long we have no core
    played.arm.publish(stamp - 1_000_000)
    data = TopicsData(played.name)
    try:
        data.rows()
        for k in range(100):
            played.arm.publish(stamp + k * 1_000_000)
        row = next(row for row in data.rows() if row.name == "PSM1/state")
        assert row.nominal_hz == 1500.0 and row.hz == pytest.approx(1000.0) and row.max_ms == pytest.approx(1.0)
        assert row.age_s is not None and row.records == 102 and not row.is_old and row.lost == 0
        for k in (0, 1, 2, 3, 34, 35, 36):
            played.arm.publish(stamp + 200_000_000 + k * 1_000_000)
        row = next(row for row in data.rows({"PSM1": 33.0}) if row.name == "PSM1/state")
        assert row.lost == 30 + 100 and row.age_s is not None and row.age_s >= 33.0 and row.is_old
        silent = next(row for row in data.rows() if row.name == "IO1/state")
        assert silent.problem == "nothing was ever written" and silent.hz is None and silent.is_old
    finally:
        data.close()


def test_topics_of_a_dead_writer_are_old(played: ScriptedRobot) -> None:
    played.arm.close()
    data = TopicsData(played.name)
    row = next(row for row in data.rows() if row.name == "PSM1/state")
    data.close()
    assert row.is_old and row.problem.startswith("its writer PSM1 (pid ")


def test_stamps_are_those_of_the_newest_records(played: ScriptedRobot) -> None:
    for k in range(10):
        played.io.publish(1000 + k)
    with Segment(segment_name(played.name, "IO1", "state")) as segment:
        assert head_of(segment) == 10 and newest_stamps(segment, 3).tolist() == [1007, 1008, 1009]
        assert len(newest_stamps(segment, 99)) == 10
    with Segment(segment_name(played.name, "IO1", "events")) as segment:
        assert newest_stamps(segment, 5).tolist() == []


def values_of(played: ScriptedRobot, topic: str) -> ValuesData:
    return ValuesData(played.name, find(played.name, topic))


def test_values_have_units_words_courses_and_ages(played: ScriptedRobot) -> None:
    data = values_of(played, "PSM1/measured_js")
    try:
        rows = {row.key: row for row in data.look(("position",)).rows}
        assert rows["position"].value == "0.25 0.25 0.25 0.25 0.25 0.25" and rows["position"].unit == "rad|m"
        assert rows["PSM1/measured_js.position[0]"].value == "0.25" and rows["velocity"].value == "– – – – – –"
        played.show_arm(0.5, age_s=-10.0)  # not old, however long we have no core
        found = data.look(("position",))
        course = {row.key: row for row in found.rows}["PSM1/measured_js.position[0]"].course
        assert course[-1] == 0.5 and course[0] == 0.25 and not found.is_old and found.sequence == 2
        played.show_arm(0.5, valid=False)
        assert {row.state for row in data.look().rows} == {"invalid"}
        assert data.look((), 40.0).age_s == 40.0 and data.look((), 40.0).is_old
    finally:
        data.close()


@pytest.mark.parametrize(("value", "text"), [
    (None, "–"), (True, "yes"), (False, "no"), (-0.0, "0"), (0.1234567, "0.12346"), (-2e7, "-2.000000e+07"), (7, "7"),
    ("", "(empty)"), ("PSM1", "PSM1")])
def test_a_value_is_readable(value: Any, text: str) -> None:
    assert shown_value(value) == text


@pytest.mark.slow
def test_looking_wants_nothing_until_a_person_does(played: ScriptedRobot) -> None:
    wanted = Subscriptions(played.pages["PSM1"])
    data = values_of(played, "PSM1/state")
    try:
        rows = {row.key: row for row in data.look().rows}
        assert rows["spatial_jacobian"].state == "not computed" and data.look().has_groups
        wanted.look()
        assert not wanted.wanted & wanted.bits("state")
        data.want()
        wanted.look()
        assert wanted.wanted & wanted.bits("state") and data.look().is_wanted
    finally:
        data.close()


def test_events_are_chosen_by_severity_and_process(played: ScriptedRobot) -> None:
    played.events.status("PSM1: HOMED", "PSM1")
    data = events.events_of(played.name)
    try:
        assert [row.text for row in data.rows()] == ["PSM1: HOMED"]
        played.events.operating_state("ENABLED", "HOMED", True, False)
        played.events.report(codes.TRACKING, "PSM1 axis 2: cannot follow", "PSM1", 2, 0.06, 0.05, 6)
        rows = data.rows()
        assert [row.severity for row in rows] == ["status", "", "error"]
        assert rows[2].hint == codes.TRACKING.remedy_for("PSM1")
        assert events.chosen(rows, "warning") == [rows[2]] and events.chosen(rows, "status") == [rows[0], rows[2]]
        assert events.chosen(rows, "", "IO1") == [] and events.chosen(rows, "", "PSM1") == rows
        assert rows[2].data["limit"] == 0.05 and data.names[0] == "IO1" and data.lost == 0
    finally:
        data.close()


def once(made: Callable[..., Any], meanwhile: Callable[[], object]) -> Callable[..., Any]:
    """The same, but while it is called the first time something happens."""
    left = [meanwhile]

    def called(*arguments: Any) -> Any:
        if left:
            left.pop()()
        return made(*arguments)

    return called


def test_events_that_come_while_it_opens_are_kept(played: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    played.events.status("PSM1: HOMED", "PSM1")
    meanwhile = once(events._event_row, lambda: played.events.status("PSM1: meanwhile", "PSM1"))
    monkeypatch.setattr(events, "_event_row", meanwhile)
    data = events.events_of(played.name)
    try:
        assert [row.text for row in data.rows()] == ["PSM1: HOMED", "PSM1: meanwhile"] and data.lost == 0
    finally:
        data.close()


def test_commands_that_come_while_it_opens_are_kept(played: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    ring = directory.writer(played.name, "PSM1", "audit", "arm")
    ring.field("command")[...], ring.field("outcome")[...] = b"hold", b"accepted"
    ring.publish(monotonic_ns())
    monkeypatch.setattr(events, "_asked_row", once(events._asked_row, lambda: ring.publish(monotonic_ns())))
    data = events.commands_of(played.name)
    try:
        assert [row.command for row in data.rows()] == ["hold", "hold"] and len(data.rows()) == 2
    finally:
        data.close()
        ring.close()


def test_a_fault_has_reason_and_remedy(played: ScriptedRobot) -> None:
    played.events.report(codes.TRACKING, "PSM1 axis 2: cannot follow", "PSM1", 2, 0.06, 0.05, 6)
    played.arm.field("reason")[...] = b"cannot follow"
    played.show_arm(0.1, "FAULT")
    (one,) = overview.overview(played.name).standings
    assert one.is_fault and processes.standing_cells(one)[3] == "tracking"
    told = "\n".join(processes.standing_details(one))
    assert "why: cannot follow" in told and "axis 2, board 6, measured 0.06, allowed 0.05" in told
    assert f"remedy: {codes.TRACKING.remedy_for('PSM1')}" in told and told.count("trocar home PSM1") == 1


def asked(key: tuple[str, int, int], outcome: str, stamp: int, stream: bool = False) -> AskedRow:
    return AskedRow(key, stamp, stamp, "", key[0], "servo_jp" if stream else "move_jp", outcome, "", "", stream)


def test_commands_are_under_way_until_they_are_answered(played: ScriptedRobot) -> None:
    living: list[ProcessStatus] = [dataclasses.replace(one, state="RUNNING", problem="") for one in
                                   statuses(played.name)]
    done = [asked(("PSM1", 1, 1), "accepted", 10), asked(("PSM1", 1, 1), "done", 11)]
    now = asked(("PSM1", 1, 2), "accepted", 12)
    assert under_way([*done, now], living) == [now]
    stream = asked(("PSM1", 1, 3), "accepted", 13, stream=True)
    assert under_way([*done, stream], living) == [stream]
    assert under_way([stream, asked(("PSM1", 1, 4), "refused", 14)], living) == []
    assert under_way([now], [dataclasses.replace(one, problem="dead") for one in living]) == []


# the verb where there is no terminal


def test_everything_is_one_document(played: ScriptedRobot) -> None:
    played.events.status("PSM1: HOMED", "PSM1")
    found = json.loads(run(played, "attach", "--json").stdout)
    assert found["supervisor"] == "RUNNING" and found["standings"][0]["name"] == "PSM1"
    assert found["values"]["PSM1/state"]["position"][0] == 0.25 and found["values"]["PSM1/state"]["velocity"][0] is None
    assert found["values"]["IO1/state"] is None and found["events"][-1]["text"] == "PSM1: HOMED"
    assert {row["name"] for row in found["topics"]} >= {"PSM1/state", "IO1/state"} and found["commands"] == []


@pytest.mark.slow
def test_without_a_terminal_it_is_printed_once(played: ScriptedRobot) -> None:
    played.events.status("PSM1: HOMED", "PSM1")
    shown = run(played, "attach")
    assert shown.exit_code == 0 and "supervisor runs" in shown.stdout and "PSM1: HOMED" in shown.stdout
    assert "nominal" in shown.stdout and "\x1b" not in shown.stdout
    assert run(played, "attach", "--once", "--json").exit_code == 2


def test_a_system_that_is_not_there_is_a_problem(world: World) -> None:
    shown = CliRunner().invoke(APP, ["attach", "--system", world.name])
    assert shown.exit_code == 1 and "trocar" in shown.stderr
