"""Events and logs as people see them: with history and time of day, in order, in words."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner, Result

from tests.tools.robot import ScriptedRobot, nothing_ages, robot
from trocar.procs.tables import codes
from trocar.shm.memory.rows import Field
from trocar.shm.topics import ARM_STATE, IO_STATE, SETPOINT
from trocar.tools import cli
from trocar.tools.inspect.enumerations import in_words

APP = cli.build()
TIME = r"\d\d:\d\d:\d\d\.\d{3}"


@pytest.fixture
def kinematic(world: Any, monkeypatch: pytest.MonkeyPatch) -> Iterator[ScriptedRobot]:
    nothing_ages(monkeypatch)
    with robot(world.name) as made:
        yield made


def run(kinematic: ScriptedRobot, *words: str) -> Result:
    return CliRunner().invoke(APP, [*words, "--system", kinematic.name])


def test_echo_of_events_prints_the_history_with_local_time(kinematic: ScriptedRobot) -> None:
    kinematic.events.status("PSM1: HOMED", "PSM1")
    kinematic.events.operating_state("ENABLED", "HOMED", True, False)
    kinematic.events.report(codes.TRACKING, "PSM1 axis 2 (insertion), board 6: cannot follow", "PSM1", 2, 0.06, 0.05, 6)
    shown = run(kinematic, "echo", "PSM1/events", "-n", "3").stdout.splitlines()
    assert [re.sub(f"^{TIME}", "AT", line) for line in shown] == [
        "AT  status  PSM1: HOMED",
        "AT  operating_state  ENABLED (HOMED), homed",
        "AT  error tracking  PSM1 axis 2 (insertion), board 6: cannot follow; "
        "check for a collision, a command that is too fast, or an encoder jump, then trocar home PSM1",
    ]


def test_echo_of_one_kind_of_event_leaves_out_the_others(kinematic: ScriptedRobot) -> None:
    kinematic.events.status("PSM1: HOMED", "PSM1")
    kinematic.events.report(codes.CLIPPED, "clipped to the joint limits: insertion", "PSM1")
    shown = run(kinematic, "echo", "PSM1/warning", "--timeout", "0")
    assert shown.exit_code == 0 and shown.stdout.count("\n") == 1
    assert "PSM1: clipped to the joint limits: insertion" in shown.stdout


def test_the_newest_are_shown_of_many_events(kinematic: ScriptedRobot) -> None:
    for number in range(9):
        kinematic.events.status(f"number {number}", "PSM1")
    shown = run(kinematic, "echo", "PSM1/status", "-n", "2").stdout.splitlines()
    assert [line[-1] for line in shown] == ["7", "8"]


@pytest.mark.parametrize("words", [("--timeout", "0"), ("-n", "3", "--timeout", "0.02"), ("--once", "--timeout", "0")])
def test_no_events_are_nothing_yet_and_the_wait_ends(kinematic: ScriptedRobot, words: tuple[str, ...]) -> None:
    shown = run(kinematic, "echo", "PSM1/error", *words)
    assert shown.exit_code == 1 and shown.stdout == "" and "PSM1/error: nothing yet" in shown.stderr


def test_counting_records_ends_where_nothing_new_comes(kinematic: ScriptedRobot) -> None:
    kinematic.show_arm()
    shown = run(kinematic, "echo", "PSM1/measured_js", "-n", "5", "--timeout", "0.05")
    assert shown.exit_code == 1 and "nothing new for 0.05 s" in shown.stderr


def test_events_carry_all_their_data_for_programs(kinematic: ScriptedRobot) -> None:
    kinematic.events.report(codes.TRACKING, "cannot follow", "PSM1", 2, 0.06, 0.05, 6)
    (row,) = (json.loads(line) for line in run(kinematic, "echo", "PSM1/error", "--once", "--json").stdout.splitlines())
    assert (row["code"], row["component"], row["axis"], row["board"], row["value"], row["limit"], row["hint"]) == (
        "tracking", "PSM1", 2, 6, 0.06, 0.05, codes.TRACKING.remedy_for("PSM1"))
    assert row["local_ns"] > 10**18 and row["monotonic_ns"] > 0


def field(topic: Any, name: str) -> Field:
    return next(f for f in topic.fields if f.name == name)


@pytest.mark.parametrize(("topic", "name", "value", "word"), [
    (ARM_STATE, "control_mode", 3, "effort"), (ARM_STATE, "control_space", 2, "Cartesian"),
    (ARM_STATE, "adapter", 4, "engaged"), (ARM_STATE, "instrument", 0, "not looked at"),
    (SETPOINT, "mode", 1, "drive the actuators as the other fields say"),
    (IO_STATE, "fault", [0, 13], ["none", "amplifier"]),
    (IO_STATE, "encoder_bits", [0, 5], [0, 5]), (IO_STATE, "cycle", 1, 1), (ARM_STATE, "count", 6, 6),
])
def test_enumerations_are_words(topic: Any, name: str, value: Any, word: Any) -> None:
    assert in_words(field(topic, name), value) == word


def test_a_record_is_printed_with_words(kinematic: ScriptedRobot) -> None:
    kinematic.arm.field("control_mode")[...] = 2
    kinematic.show_arm()
    shown = run(kinematic, "echo", "PSM1/state", "--once").stdout
    assert re.search(r"control_mode +trajectory", shown) and re.search(r"is_homed +no", shown)


def test_logs_of_several_come_in_the_order_in_which_they_were_written(
    kinematic: ScriptedRobot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    folder = tmp_path / kinematic.name
    folder.mkdir()
    day = "2026-11-22 20:50:01.12345"
    (folder / "IO1.log").write_text(f"{day}6 10.5 ERROR PSM1 axis 2: too far\n{day}7 12.5 INFO ended\nTraceback\n")
    (folder / "PSM1.log").write_text(f"{day}6 11.5 ERROR PSM1 axis 2: too far\n{day}8 13.5 INFO ended\n")
    shown = run(kinematic, "logs").stdout.splitlines()
    assert shown == ["20:50:01.123  IO1  ERROR  PSM1 axis 2: too far",
                     "20:50:01.123  PSM1  ERROR  PSM1 axis 2: too far",
                     "20:50:01.123  IO1  INFO  ended", "IO1  Traceback", "20:50:01.123  PSM1  INFO  ended"]
    rows = [json.loads(line) for line in run(kinematic, "logs", "--json").stdout.splitlines()]
    assert [row["monotonic_s"] for row in rows] == [10.5, 11.5, 12.5, None, 13.5]
