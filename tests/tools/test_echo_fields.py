"""`trocar echo` and `hz` of fields: on the screen, as JSON, as CSV."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from tests.tools.robot import ScriptedRobot, robot
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.system_time import SystemTime
from trocar.tools import cli
from trocar.tools.inspect.replayed import clock_in_words

APP = cli.build()


@pytest.fixture
def played(world: Any) -> Iterator[ScriptedRobot]:
    with robot(world.name) as made:
        made.show_arm(0.25)
        yield made


def run(played: ScriptedRobot, *words: str) -> Result:
    return CliRunner().invoke(APP, [*words, "--system", played.name])


@pytest.mark.slow
def test_a_field_is_a_line(played: ScriptedRobot) -> None:
    shown = run(played, "echo", "PSM1/measured_js.position[0:3]", "--once")
    assert re.fullmatch(r"\d+\.\d{6}  0\.25 0\.25 0\.25  rad\|m\n", shown.stdout) and shown.exit_code == 0
    assert run(played, "echo", "PSM1/state.state", "--once").stdout.endswith("  DISABLED\n")
    assert run(played, "echo", "PSM1/state.reason", "--once").stdout.endswith('  ""\n')


@pytest.mark.parametrize("topic", ["PSM1/measured_js", "PSM1/measured_cp", "PSM1/jaw/measured_js"])
def test_what_is_shown_of_a_topic_has_a_path(played: ScriptedRobot, topic: str) -> None:
    whole = json.loads(run(played, "echo", topic, "--once", "--json").stdout)
    for field, value in whole.items():
        shown = run(played, "echo", f"{topic}.{field}", "--once", "--json")
        assert shown.exit_code == 0, shown.stderr
        assert json.loads(shown.stdout)["value"] == value, field
    played.show_arm(0.5, valid=False)
    assert run(played, "echo", "PSM1/measured_js.valid", "--once").stdout.endswith("  no\n")


def test_a_field_is_data_for_programs(played: ScriptedRobot) -> None:
    row = json.loads(run(played, "echo", "PSM1/measured_js.position[1]", "--once", "--json").stdout)
    assert row["value"] == 0.25 and row["field"] == "PSM1/measured_js.position[1]" and row["sequence"] == 1
    row = json.loads(run(played, "echo", "PSM1/measured_js.velocity[0:2]", "--once", "--json").stdout)
    assert row["value"] == [None, None]
    row = json.loads(run(played, "echo", "PSM1/state.jacobian[0:2][0:2]", "--once", "--json").stdout)
    assert row["value"] == [[1.0, 1.0], [1.0, 1.0]]


def test_a_topic_and_a_field_are_tables(played: ScriptedRobot, tmp_path: Path) -> None:
    shown = list(csv.reader(io.StringIO(run(played, "echo", "PSM1/measured_js", "--once", "--csv", "-").stdout)))
    assert shown[0][:4] == ["stamp_ns", "sequence", "PSM1/measured_js.name[0]", "PSM1/measured_js.name[1]"]
    row = dict(zip(*shown, strict=True))
    assert row["PSM1/measured_js.position[5]"] == "0.25" and row["PSM1/measured_js.velocity[0]"] == ""
    file = tmp_path / "table.csv"
    assert run(played, "echo", "PSM1/jaw/measured_js.position", "--once", "--csv", str(file)).exit_code == 0
    assert file.read_text().splitlines()[1].endswith(",1,0.25")


def test_what_is_not_valid_is_empty(played: ScriptedRobot) -> None:
    played.show_arm(0.5, valid=False)
    assert run(played, "echo", "PSM1/measured_js.position[0]", "--once", "--csv", "-").stdout.endswith(",2,\n")


@pytest.mark.parametrize(("words", "why"), [
    (("PSM1/measured_js.positin",), "did you mean position"), (("PSM1/measured_js.position[",), "is no field"),
    (("PSM1/measured_js.position[9]",), "has 6 numbers"), (("PSM1/error.value",), "use PSM1/events.value"),
    (("PSM1/state", "--csv", "-", "--json"), "cannot combine"),
])
def test_what_is_no_field_is_used_wrongly(played: ScriptedRobot, words: tuple[str, ...], why: str) -> None:
    shown = run(played, "echo", *words, "--once")
    assert shown.exit_code == 2 and why in shown.stderr


def test_a_file_that_cannot_be_written_is_a_problem(played: ScriptedRobot) -> None:
    shown = run(played, "echo", "PSM1/state", "--once", "--csv", "/nowhere/at/all.csv")
    assert shown.exit_code == 1 and "/nowhere/at/all.csv: cannot be written: No such file" in shown.stderr


def test_hz_of_a_field_counts_in_the_time_that_the_ring_keeps(played: ScriptedRobot, monkeypatch: pytest.MonkeyPatch
                                                              ) -> None:
    def ten_seconds(seconds: float) -> None:
        for n in range(1, 10_001):
            played.arm.field("position")[0] = n
            played.arm.publish(begin_ns + n * 1_000_000)

    begin_ns = played.arm.stamp_ns
    monkeypatch.setattr("trocar.tools.verbs.listing.pause", ten_seconds)
    row = json.loads(run(played, "hz", "PSM1/state.position[0]", "--json", "--window", "10").stdout)
    assert row["records"] == 10_000 and row["changes_hz"] == pytest.approx(1000.0)


def test_hz_of_a_field_counts_its_changes(played: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    def meanwhile(seconds: float) -> None:
        for value in (0.1, 0.1, 0.2, 0.3):
            played.show_arm(value)

    monkeypatch.setattr("trocar.tools.verbs.listing.pause", meanwhile)
    row = json.loads(run(played, "hz", "PSM1/measured_js.position[0]", "--json", "--window", "2").stdout)
    assert row["topic"] == "PSM1/measured_js.position[0]" and row["records"] == 4 and row["changes_hz"] == 1.0
    unknown = json.loads(run(played, "hz", "PSM1/measured_js.velocity", "--json", "--window", "2").stdout)
    assert unknown["records"] == 4 and unknown["changes_hz"] == 0.0, "what is not known all the time does not change"
    assert "changes" in run(played, "hz", "PSM1/measured_js.position[0]").stdout
    assert run(played, "hz", "PSM1/measured_js.nothing").exit_code == 2
    table = run(played, "hz", "PSM1/state", "--csv", "-").stdout.splitlines()
    assert table[0].startswith("topic,records,") and table[1].startswith("PSM1/state,4,1500.0,")


def test_the_age_beside_a_dead_writer_is_at_least_that_of_its_last_heartbeat(played: ScriptedRobot) -> None:
    age = re.compile(r"age ([\d.]+) (ms|s)")
    played.pages["PSM1"].field("heartbeat_ns")[...] = monotonic_ns() - 20_000_000_000
    played.show_arm(0.25)
    found = age.search(run(played, "echo", "PSM1/state", "--once").stdout)
    assert found is not None and found[2] == "ms", "it lives, and its record is new"
    played.arm.close()
    found = age.search(run(played, "echo", "PSM1/state", "--once").stdout)
    assert found is not None and found[2] == "s" and 20.0 <= float(found[1]) < 100.0


def test_the_clock_has_a_speed_only_beside_a_supervisor_that_lives(
        played: ScriptedRobot, monkeypatch: pytest.MonkeyPatch) -> None:
    with SystemTime(played.name) as time:
        monkeypatch.setattr(time, "clock", "paced")
        monkeypatch.setattr(SystemTime, "simulated", True)
        assert "of real time" in clock_in_words(played.name, time)
        played.pages["supervisor"].close()
        assert clock_in_words(played.name, time) == "paced"
