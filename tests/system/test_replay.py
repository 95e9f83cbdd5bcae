"""`trocar replay` of a system in lock-step that ordinary programs drove: the same once more, bit for bit."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from procs.recordings.reading import open_recording
from tests.system.conftest import systems
from tests.system.robot import ROOT, Robot

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
KINEMATIC = ROOT / "configs/systems/kinematic.yaml"
GOAL = (0.2, -0.1, 0.15, 0.4, 0.3, -0.2)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("replay")


@pytest.fixture(scope="module")
def robot(folder: Path) -> Iterator[Robot]:
    with systems(folder) as make:
        yield make()


@pytest.fixture(scope="module")
def recorded(robot: Robot, folder: Path) -> Path:
    """Homed, moved by a command, then by a stream of 100 goals."""
    robot.up(KINEMATIC, "--clock", "lockstep")
    robot.trocar("home", "PSM1")
    robot.trocar("send", "PSM1", "move_jp", *map(str, GOAL), "--wait")
    robot.trocar("stream", "PSM1", "configs/recordings/psm-wave.csv", "--rate", "200", "--for", "0.5")
    robot.trocar("dump", str(folder / "one.mcap"))
    return folder / "one.mcap"


def test_a_run_in_lock_step_replays_bit_for_bit(robot: Robot, recorded: Path, folder: Path) -> None:
    said = json.loads(robot.trocar("replay", str(recorded), "--fresh", "--into", str(folder / "again.mcap"), "--json"))
    assert said["difference"]["outcome"] == "equal" and said["commands"] >= 103, said
    topics = {row["topic"]: row["compared"] for row in said["difference"]["topics"]}
    assert min(topics[name] for name in ("PSM1/state", "PSM1/setpoint", "io/state")) > 1000
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
