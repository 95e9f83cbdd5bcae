"""`trocar replay` of a system in lock-step that ordinary programs drove: the same once more, bit for bit."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import trocar
from tests.system.conftest import systems
from tests.system.robot import DEMO, LED, ROOT, SLOWER, Robot, time_passes, wait_for
from trocar.procs.recordings.reading import open_recording
from trocar.shm.memory.segment import names_of
from trocar.tools.analysis.choosing import start_ns

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
KINEMATIC = ROOT / "configs/systems/kinematic.yaml"
GOAL = (0.2, -0.1, 0.15, 0.4, 0.3, -0.2)
BETWEEN = (0.18, -0.1, 0.15, 0.37, 0.3, -0.16)
NEAR = (0.16, -0.09, 0.148, 0.35, 0.28, -0.14)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("replay")


@pytest.fixture(scope="module")
def robot(folder: Path) -> Iterator[Robot]:
    with systems(folder, LED) as make:
        yield make()


@pytest.fixture(scope="module")
def recorded(robot: Robot, folder: Path) -> Path:
    """Homed, moved by a command, by a stream of 40 goals, and by a command again."""
    made = folder / "one.mcap"

    robot.up(KINEMATIC)
    robot.home("PSM1")
    robot.trocar("send", "PSM1", "move_jp", *map(str, GOAL), "--wait")
    with trocar.psm("PSM1", robot.name) as psm, time_passes():  # rings keep 0.7 s, and a verb takes time to begin
        for share in np.linspace(0.0, 1.0, 40):
            psm.servo_jp((1.0 - share) * np.array(GOAL) + share * np.array(BETWEEN))
        psm.move_jp(NEAR).wait(60.0)
    assert robot.popen("dump", str(made)).wait(60.0) == 0  # while time stands still
    return made


def test_a_run_in_lock_step_replays_bit_for_bit(robot: Robot, recorded: Path, folder: Path) -> None:
    replay = robot.patiently("replay", str(recorded), "--fresh", "--into", str(folder / "again.mcap"), "--json")
    assert replay.returncode == 0, replay.stdout + replay.stderr
    said = json.loads(replay.stdout)
    assert said["difference"]["outcome"] == "equal" and said["commands"] > 20, said
    topics = {row["topic"]: row["compared"] for row in said["difference"]["topics"]}
    assert topics["io/state"] > 300 and min(topics["PSM1/state"], topics["PSM1/setpoint"]) > 100
    assert "equal" in robot.trocar("compare", str(recorded), str(folder / "again.mcap"), "--common")
    with open_recording(folder / "again.mcap") as again:
        rows = again.records("PSM1/state").rows
        assert again.is_whole and not again.problems and int(rows["sequence"][0]) == 1
        assert np.ptp(rows["position"][:, :6], axis=0).min() > 0.05, "it moved"


def test_what_cannot_be_repeated_is_refused(robot: Robot, recorded: Path, folder: Path) -> None:
    said = robot.types("replay", str(recorded), "--fresh", "--into", str(recorded))
    assert said.returncode == 2 and "is there already" in said.stderr
    data = recorded.read_bytes()
    (folder / "other.mcap").write_bytes(data.replace(b"document.json.gz", b"somethingelse.gz"))
    said = robot.types("replay", str(folder / "other.mcap"), "--fresh", "--into", str(folder / "new.mcap"))
    assert said.returncode == 1 and "has no configuration" in said.stderr and not (folder / "new.mcap").exists()


def test_recorded_setpoints_move_the_arm_of_a_running_system(robot: Robot, recorded: Path) -> None:
    robot.trocar("send", "PSM1", "move_jp", "0", "0", "0.12", "0", "0", "0", "--wait")
    replay = robot.patiently("replay", str(recorded), "--arms", "PSM1", "--speed", "2", "--json")
    assert replay.returncode == 0, replay.stderr
    said = json.loads(replay.stdout)
    assert said["arm"] == "PSM1" and not said["refused"] and said["samples"] > 100
    with open_recording(recorded) as recording:
        last = recording.records("PSM1/state").rows["setpoint_position"][-1][:6]
    state = json.loads(robot.trocar("echo", "PSM1/state", "--once", "--json"))
    assert np.allclose(state["setpoint_position"][:6], last, atol=0.02)
    assert max(said["recorded_rms"][:6]) < 0.05, "docs/recordings.md: about where it was when it was recorded"


def test_recorded_commands_are_asked_for_again(robot: Robot, recorded: Path) -> None:
    replay = robot.patiently("replay", str(recorded), "--commands", "--arms", "PSM1", "--speed", "4", "--json")
    rows = [json.loads(line) for line in replay.stdout.splitlines()]
    assert replay.returncode == 0, replay.stderr
    assert rows and {row["command"] for row in rows} <= {"move_jp", "hold"}, rows  # those in the rings
    assert all(row["outcome"] == "done" or "replaced by" in row["reply"] for row in rows), rows
    assert "which is not a move" in replay.stderr, "streams are left out, and that is said"
    said = robot.types("replay", str(recorded), "--arms", "PSM9")
    assert said.returncode == 1 and "no arm PSM9" in said.stderr
    assert robot.types("replay", str(recorded), "--speed", "0").returncode == 2


def test_an_arm_that_is_not_homed_is_not_moved(robot: Robot, recorded: Path) -> None:
    robot.trocar("power-off", "PSM1")
    said = robot.types("replay", str(recorded), "--arms", "PSM1")
    assert said.returncode == 1 and "is not homed; first: trocar home PSM1" in said.stderr
    robot.trocar("home", "PSM1")


def test_records_are_shown_as_a_system_that_only_can_be_looked_at(robot: Robot, recorded: Path) -> None:
    name = f"{robot.name}shown"
    with open_recording(recorded) as recording:  # rings that are seldom written go back further than those of the arm
        first_ns = int(recording.records("PSM1/state").rows["stamp_ns"][0])
        late = f"{(first_ns - start_ns(recording)) * 1e-9 + 0.1:.3f}"
    shown = subprocess.Popen([sys.executable, "-m", "trocar", "replay", str(recorded), "--as", name, "--speed", "0.01",
                              "--from", late],
                             cwd=ROOT, env=robot.environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        wait_for(lambda: (name, "PSM1", "state") in names_of(name), 30, "the rings")
        wait_for(lambda: "PSM1/measured_js" in robot.trocar("list", "--system", name), 30, "what was recorded")
        wait_for(lambda: robot.types("echo", "PSM1/state", "--once", "--system", name).returncode == 0, 30, "a record")
        rows = robot.trocar("echo", "PSM1/state", "-n", "3", "--timeout", "30", "--json", "--system", name).splitlines()
        assert json.loads(rows[0])["state"] == "ENABLED" and len(rows) == 3
        assert '"simulation": "REPLAY"' in robot.trocar("list", "--json", "--system", name)
        assert robot.types("send", "PSM1", "hold", "--system", name).returncode != 0
        taken = robot.types("replay", str(recorded), "--as", robot.name)
        assert taken.returncode == 1 and "is there already" in taken.stderr
    finally:
        shown.send_signal(signal.SIGINT)
        _, said = shown.communicate(timeout=30)
    assert shown.returncode == 0 and not names_of(name), said


def test_nothing_is_left_of_a_system_that_was_shown_by_who_is_killed(robot: Robot, recorded: Path) -> None:
    name = f"{robot.name}killed"
    shown = subprocess.Popen([sys.executable, "-m", "trocar", "replay", str(recorded), "--as", name, "--speed", "0.05"],
                             cwd=ROOT, env=robot.environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    wait_for(lambda: (name, "PSM1", "state") in names_of(name), 30, "the rings")
    shown.kill()
    shown.wait()
    wait_for(lambda: not names_of(name), 30, "all is gone")


def recorded_whole(robot: Robot) -> Path | None:
    """Homed and moved in lock-step, from the first instant on; None where the recorder was held up and lost some."""
    robot.up(DEMO, "--set", "recorder.on=true", "--set", "arm.period_s=0.004")  # turns: every second one of io
    robot.trocar("record", "run", "--detach")
    robot.trocar("home", "PSM1")
    robot.trocar("send", "PSM1", "move_jp", *map(str, GOAL), "--wait")
    is_whole = robot.types("record", "run", "--stop").returncode == 0
    robot.down()
    if not is_whole:
        return None
    [made] = (robot.logs / robot.name / "recordings").glob("run-*.mcap")
    return made


def test_a_run_on_emulated_boards_that_was_recorded_whole_replays_bit_for_bit(robots: Callable[[], Robot]) -> None:
    made, said = None, dict[str, Any]()
    for _ in range(5):  # boards that the machine keeps from a core for half a second are a missed read, which io tells
        robot = robots()
        if (made := recorded_whole(robot)) is None:
            continue
        replayed = robot.patiently("replay", str(made), "--fresh", "--json")
        said = json.loads(replayed.stdout or "{}")
        different = [row["topic"] for row in said["difference"]["topics"] if not row["equal"]] if said else []
        if said and "IO1/events" not in different:
            break
    assert made is not None, "the recorder lost records each time"
    assert said, replayed.stderr
    assert said["difference"]["outcome"] == "equal" and said["commands"] >= 2, different
    topics = {row["topic"]: row["compared"] for row in said["difference"]["topics"]}
    assert min(topics[name] for name in ("PSM1/state", "PSM1/setpoint", "IO1/state")) > 1000
    with open_recording(made) as recording:
        rows = recording.records("PSM1/state").rows
        assert np.ptp(rows["position"][:, :6], axis=0).min() > 0.05, "measured joints, which moved"


@pytest.mark.parametrize("clock", [pytest.param("wall", marks=pytest.mark.soak), "paced"])
def test_a_stream_comes_as_near_as_is_said_on_a_clock_that_does_not_wait(robots: Callable[[], Robot], clock: str
                                                                         ) -> None:
    robot = robots()
    robot.up(DEMO, *SLOWER, "--clock", clock, "--set", "recorder.on=true")
    robot.home("PSM1")

    def done(*words: str) -> dict[str, Any]:
        """What it says at its end."""
        said = robot.patiently(*words, "--json")
        assert said.returncode == 0, said.stderr
        found: dict[str, Any] = json.loads(said.stdout.splitlines()[-1])
        return found

    for _ in range(5):
        robot.trocar("record", "run", "PSM1", "--detach")
        done("stream", "PSM1", "configs/recordings/psm-wave.csv", "--for", "1")
        if robot.types("record", "run", "--stop").returncode == 0:  # else records are missing: it was held up
            break
    made = max((robot.logs / robot.name / "recordings").glob("run-*.mcap"))
    said = done("replay", str(made), "--arms", "PSM1")
    most = dict(zip(said["names"], said["recorded_max"], strict=False))
    assert said["samples"] > 50 and not said["refused"], said
    assert most.pop("insertion") < 0.002, "m: docs/recordings.md"
    assert len(most) == 5 and max(most.values()) < 0.02, most
