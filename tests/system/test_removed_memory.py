"""Another program removes shared memory under a running robot, as logind does at a logout (RemoveIPC=yes)."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tests.system.robot import DEMO, Robot, wait_for
from trocar.shm.memory.segment import FOLDER, names_of, path_of, segment_name
from trocar.tools.systems.find import all_up
from trocar.tools.systems.processes import running

pytestmark = [pytest.mark.slow, pytest.mark.simulated]


def removed(robot: Robot) -> None:
    """All segments lose their names."""
    for parts in names_of(robot.name):
        Path(FOLDER / segment_name(*parts)[1:]).unlink()


def test_each_single_segment_is_missed_by_name(running_demo: Robot, tmp_path: Path) -> None:
    for number, parts in enumerate(names_of(running_demo.name)):
        path = path_of(segment_name(*parts))
        aside = path.rename(path.with_name(f"aside-{running_demo.name}"))
        try:
            verb = ("status", "list", "power-off", "dump")[number % 4]
            reported = running_demo.trocar(verb, *[str(tmp_path / f"{number}.mcap")] * (verb == "dump"), code=1)
        finally:
            aside.rename(path)
        assert f"{parts[1]}~{parts[2]}" in "".join(reported.split()), (verb, reported)
    assert running_demo.types("status").returncode == 0


def test_a_robot_whose_memory_was_removed_stays_within_reach(demo: Robot, tmp_path: Path) -> None:
    segments = len(names_of(demo.name))
    removed(demo)
    assert names_of(demo.name) == []
    told = f"{segments} of {segments} segments were removed from /dev/shm"
    for words in (("status",), ("list",), ("dump", str(tmp_path / "dump.mcap"))):
        assert told in " ".join(demo.trocar(*words, code=1).split())
    wait_for(lambda: told in demo.output(), 20, "the supervisor reports it")
    assert "up already" in demo.trocar("up", str(DEMO), code=1)
    assert demo.name in all_up()
    before = demo.kill("PSM1")
    demo.comes_back("PSM1", before)
    arms = demo.trocar("status", "--json", code=1)
    assert [(one["name"], one["homed"]) for one in json.loads(arms)["standings"]] == [("PSM1", True)]
    off = demo.trocar("power-off", code=1)
    assert told in off and "disabled" in off and "NOT" not in off
    assert f"system {demo.name} is down" in demo.trocar("down")
    assert running(demo.name) == [] and names_of(demo.name) == []
