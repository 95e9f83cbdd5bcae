"""The recorder of a whole system: what people ask of it, what it keeps by itself, and who may kill it."""

from __future__ import annotations

import contextlib
import json
import os
import signal
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.system.conftest import systems
from tests.system.robot import COARSE_ON_BOARDS, ROOT, SLOWER, Robot, wait_for
from trocar.procs.recordings import names
from trocar.procs.recordings.reading import open_recording
from trocar.shm.memory.parts import remove_all
from trocar.shm.system import directory

pytestmark = [pytest.mark.slow, pytest.mark.patient]
KINEMATIC = ROOT / "configs" / "systems" / "kinematic.yaml"
ON = ("--set", "recorder.on=true")


def files(robot: Robot, pattern: str) -> list[Path]:
    return sorted((robot.logs / robot.name / "recordings").glob(pattern))


def records_in(path: Path) -> int:
    """Of PSM1, in a file that may still be written."""
    if not path.stat().st_size:
        return 0
    with open_recording(path) as recording:
        return len(recording.records("PSM1/state").rows) if "PSM1/state" in recording.topics else 0


def messages(robot: Robot) -> int:
    """Of the recording that is under way."""
    return int(json.loads(robot.trocar("echo", "recorder/state", "--json", "--once"))["messages"])


def without_loss(robot: Robot, name: str, *topics: str) -> Path:
    """A recording of 1000 messages and more; made again where a busy machine held the recorder up."""
    for _ in range(5):
        if robot.types("record", name, *topics, "--detach").returncode == 0:
            wait_for(lambda: messages(robot) > 1000, 60, "it is recorded")
        said = robot.types("record", name, "--stop", "--json")
        if said.returncode == 0:  # else records are missing, or it did not answer in time
            return Path(json.loads(said.stdout)["path"])
    pytest.fail(said.stdout + said.stderr)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """A PSM without boards, homed, in paced time, with a recorder."""
    with systems(tmp_path_factory.mktemp("recorded"), "paced") as make:
        robot = make()
        robot.up(KINEMATIC, *ON)
        robot.comes_back("recorder", 0)
        robot.home()
        yield robot


def test_a_recording_has_every_record_of_what_was_chosen(recorded: Robot) -> None:
    with open_recording(without_loss(recorded, "grasp", "PSM1/state", "io/state")) as recording:
        assert recording.is_whole
        for topic in ("PSM1/state", "io/state"):
            rows = recording.records(topic)
            assert len(rows.rows) > 100
            assert rows.missing == 0
        clock = recording.records(names.CLOCK).rows
        assert (np.diff(clock["monotonic_ns"].astype(np.int64)) > 0).all()
        assert (np.diff(clock["system_ns"].astype(np.int64)) >= 0).all()
        assert clock["system_ns"][-1] > clock["system_ns"][0]
        assert len(list(recording.messages("PSM1/measured_js"))) > 10
        assert [row["command"] for row in recording.commands() if row["instance"] == "recorder"] == ["choose"] * 2 + [
            "record"] or recording.commands()


def test_a_recording_goes_on_until_it_is_stopped(recorded: Robot) -> None:
    recorded.trocar("record", "run", "--detach")
    assert "run is being recorded" in recorded.trocar("record", "other", code=1)
    wait_for(lambda: messages(recorded) > 100, 60, "it is recorded")
    assert " lost: " in recorded.trocar("record", "run", "--stop", code=None)
    assert "not being recorded" in recorded.trocar("record", "--stop", code=1)
    assert "no topic PSM7" in recorded.trocar("record", "wrong", "PSM7", code=1)
    assert "is no name" in recorded.trocar("record", "fault-x", code=1)


def test_properties_are_seen_and_set(recorded: Robot) -> None:
    assert "recorder.minutes = 10" in recorded.trocar("get", "recorder")
    recorded.trocar("set", "recorder.minutes", "2.5")
    assert "recorder.minutes = 2.5" in recorded.trocar("get", "recorder.minutes")
    assert "out of range" in recorded.trocar("set", "recorder.rate_hz", "1000", code=1)
    assert "no compression" in recorded.trocar("set", "recorder.compression", "zip", code=1)


def test_what_is_computed_on_demand_is_wanted_while_it_is_recorded(recorded: Robot) -> None:
    with open_recording(without_loss(recorded, "wanted", "PSM1/state")) as recording:
        rows = recording.records("PSM1/state").rows
        schema = json.loads(recording.topics["PSM1/state"].schema)
        on_demand = [field["name"] for field in schema["fields"] if field.get("group") == "wrench"]
        assert on_demand
        assert all((rows[name][-1] == rows[name][-1]).any() for name in on_demand)


def test_a_killed_recorder_leaves_readable_files_and_comes_back(recorded: Robot) -> None:
    wait_for(lambda: any(records_in(path) > 10 for path in files(recorded, "box-*.mcap")[-1:]), 30, "some records")
    cycles, io = recorded.cell("io", "cycles"), recorded.pid("io")
    pid = recorded.kill("recorder")
    with open_recording(files(recorded, "box-*.mcap")[-1]) as recording:
        assert len(recording.records("PSM1/state").rows) > 10
        assert not recording.is_whole
    recorded.comes_back("recorder", pid)
    assert recorded.cell("io", "cycles") > cycles and recorded.pid("io") == io


def test_a_recording_whose_recorder_dies_fails_and_is_readable(recorded: Robot) -> None:
    with ThreadPoolExecutor(1) as pool:
        said = pool.submit(recorded.trocar, "record", "dies", "PSM1/state", "--for", "60", code=1)
        wait_for(lambda: any(records_in(path) > 50 for path in files(recorded, "dies-*.mcap")), 30, "some records")
        pid = recorded.kill("recorder")
        assert "the recording up to then is in" in said.result(60)
    assert records_in(files(recorded, "dies-*.mcap")[-1]) > 50
    recorded.comes_back("recorder", pid)


def test_a_frozen_recorder_is_killed_and_the_arm_stays_homed(recorded: Robot) -> None:
    pid = recorded.pid("recorder")
    os.kill(pid, signal.SIGSTOP)
    recorded.comes_back("recorder", pid)
    assert json.loads(recorded.trocar("echo", "PSM1/state", "--json", "--once"))["is_homed"]


def test_what_led_to_a_fault_is_kept_and_named(robot: Robot) -> None:
    robot.up(ROOT / "configs" / "systems" / "demo.yaml", *SLOWER, *ON, "--clock", "paced")
    robot.comes_back("recorder", 0)
    robot.trocar("power-on")
    wait_for(lambda: robot.cell("IO1", "cycles") > 1500, 300, "there is something before")
    robot.trocar("send", "boards", "emergency_stop", "1")
    wait_for(lambda: named(robot), 60, "status names the file")
    path = named(robot)
    assert path in robot.trocar("status", code=None)
    wait_for(lambda: _is_whole(Path(path)), 30, "it is written")
    with open_recording(Path(path)) as recording:
        facts = recording.metadata[names.SYSTEM]
        assert (facts["kind"], facts["system"]) == (names.FAULT, robot.name)
        assert "FAULT" in facts["reason"] or "power" in facts["reason"]
        rows = recording.records("IO1/state")  # an arm at rest writes fewer
        assert (recording.end_ns - recording.begin_ns) * 1e-9 > 1.0
        depth, lost = int(directory.HISTORY_S * 500), int(recording.metadata[names.LOSSES]["IO1/state"])
        assert (np.diff(rows.rows["sequence"]) == 1).sum() >= depth - 2 - lost and lost < 100  # all that the ring had
        assert any(row["code"] for row in recording.events())
    assert f"kept in {path}"[:60] in robot.trocar("logs", code=None)
    assert robot.down() == 0
    with open_recording(files(robot, "box-*.mcap")[-1]) as recording:
        assert recording.is_whole
        assert names.LOSSES in recording.metadata


def test_homings_that_fail_again_do_not_push_out_what_they_came_of(robot: Robot) -> None:
    robot.up(ROOT / "configs" / "systems" / "demo.yaml", *COARSE_ON_BOARDS, *ON, "--clock", "paced")
    robot.comes_back("recorder", 0)
    robot.trocar("set", "recorder.faults", "2")
    robot.trocar("power-on")
    robot.trocar("send", "boards", "emergency_stop", "1")
    wait_for(lambda: named(robot), 120, "status names the file")
    first = named(robot)
    for _ in range(2):
        seen = {named(robot), ""}
        assert robot.types("home", "--timeout", "20").returncode == 1, "the emergency stop is still pressed"
        assert named(robot) not in seen - {""}, "right after the fault, a file of an older one is named"
        wait_for(partial(_names_another, robot, seen), 120, "status names the file of this fault, and no other")
        wait_for(lambda: _faults(robot)[0]["path"] == named(robot), 30, "it is the newest")
    wait_for(lambda: [row["path"] for row in _faults(robot)] == [named(robot), first], 30, "the others are removed")
    rows = _faults(robot)
    assert [row["first"] for row in rows] == [False, True]
    assert all(row["code"] and "is in FAULT" not in row["reason"] for row in rows), rows
    assert rows[1]["code"] in robot.trocar("recordings", "fault")
    robot.trocar("send", "boards", "emergency_stop", "0")
    robot.home()
    robot.trocar("record", "after", "PSM1/state", "--for", "0.5", code=None)  # what it was asked before is done
    assert _faults(robot) == rows, "leaving FAULT is no fault"


def _faults(robot: Robot) -> list[dict[str, Any]]:
    return [json.loads(line) for line in robot.trocar("recordings", "fault", "--json").splitlines()]


def _names_another(robot: Robot, seen: set[str]) -> bool:
    return named(robot) not in seen


def named(robot: Robot) -> str:
    """The file that status names; empty: none."""
    return str(json.loads(robot.trocar("status", "--json", code=None))["recorded"])


def _is_whole(path: Path) -> bool:
    with open_recording(path) as recording:
        return recording.is_whole


def test_files_are_readable_after_everything_was_killed_at_once(robot: Robot) -> None:
    robot.up(KINEMATIC, *SLOWER, *ON, "--set", "supervisor_lost_s=20")  # no process ends by itself between two kills
    robot.comes_back("recorder", 0)
    assert robot.supervisor is not None
    recorder = robot.pid("recorder")
    wait_for(lambda: any(records_in(path) > 20 for path in files(robot, "box-*.mcap")), 30, "some records")
    for pid in dict.fromkeys((robot.supervisor.pid, recorder, *robot.pids)):
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    robot.supervisor.wait(30)
    with open_recording(files(robot, "box-*.mcap")[-1]) as recording:
        assert not recording.is_whole
        assert len(recording.records("PSM1/state").rows) > 20
        assert recording.events()
    wait_for(lambda: not [line for line in robot.left_over() if line.startswith("process")], 30, "all have ended")
    remove_all(robot.name)
