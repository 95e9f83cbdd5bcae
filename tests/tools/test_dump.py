"""`trocar dump`, and what `up` and `down` keep of a dead system, with a real one that was killed altogether."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest

from tests.system.robot import wait_for
from tests.tools.test_down import FILE, is_down, up
from trocar.procs.recordings.reading import open_recording
from trocar.shm.memory.segment import Segment, names_of, segment_name
from trocar.shm.system import directory
from trocar.tools.systems.dumping import STATUS
from trocar.tools.systems.processes import running

pytestmark = pytest.mark.slow


def held(system: str) -> dict[str, int]:
    """How many records each ring has, as its head and depth say."""
    found = {}
    for instance, ring in directory.rings(system):
        with Segment(segment_name(system, instance, ring)) as segment:
            reader = directory.reader(system, instance, ring, often=False)
            found[f"{instance}/{ring}"] = min(reader.head, segment.header.depth - 1)
            reader.close()
    return found


def test_what_a_system_held_that_was_killed_at_once_is_saved_whole(tmp_path: Path) -> None:
    with up(tmp_path, "--clock", "wall") as robot:
        robot.home("PSM1")
        for process in running(robot.name):
            os.kill(process.pid, signal.SIGKILL)
        wait_for(lambda: not running(robot.name), 10.0, "the end of all processes")
        assert robot.supervisor is not None
        robot.supervisor.wait(10)
        expected, file = held(robot.name), tmp_path / "all.mcap"
        said = json.loads(robot.trocar("dump", str(file), "--json", "--system", robot.name))
        assert said["records"] == expected and said["problems"] == [] and said["file"] == str(file)
        with open_recording(file) as recording:
            assert recording.is_whole
            assert {name: len(recording.records(name).rows) for name in recording.record_topics} == expected
            assert recording.records("PSM1/state").rows["is_homed"][-1]
            assert json.loads(recording.document)["name"] == robot.name
            status = json.loads(recording.attachment(STATUS))
            assert {row["name"] for row in status} >= {"supervisor", "PSM1"}
            assert any(row["command"] == "state_command" and row["text"] == "home" for row in recording.commands())
        assert "is there already" in robot.trocar("dump", str(file), "--system", robot.name, code=1)

        folder = tmp_path / robot.name / "recordings"
        folder.mkdir(parents=True, exist_ok=True)
        by_time = json.loads(robot.trocar("dump", "--json", "--system", robot.name))["file"]
        robot.up(FILE)
        [kept] = folder.glob("died-*.mcap")
        with open_recording(kept) as recording:
            assert len(recording.records("PSM1/state").rows) == expected["PSM1/state"]

        robot.kill("supervisor")
        assert "segments left by" in robot.trocar("down", "--system", robot.name)
        assert len(list(folder.glob("died-*.mcap"))) == 2, "the one before is there, too"
        assert list(folder.glob("dump-*.mcap")) == [Path(by_time)]
        assert is_down(robot), names_of(robot.name)
