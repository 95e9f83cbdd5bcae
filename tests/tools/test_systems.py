"""Finding systems among what many dead ones have left in shared memory."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.conftest import World
from trocar.shm.memory import segment
from trocar.shm.memory.owners import SERVICE_USER
from trocar.tools.output.errors import Problem
from trocar.tools.systems import find as systems
from trocar.tools.systems import supervising
from trocar.tools.systems.processes import RunningProcess
from trocar.tools.verbs import logs, recordings

DEAD = 30


@pytest.fixture
def looks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """How often what costs time is done, beside so many dead systems."""
    for k in range(DEAD):
        for what in ("document", "control", "state", "events"):
            (tmp_path / f"trocar~old{k:02}~supervisor~{what}").write_bytes(b"")
    monkeypatch.setattr(segment, "FOLDER", tmp_path)
    monkeypatch.setattr(systems, "running", lambda system=None: [])  # others may be up on this machine
    monkeypatch.setattr(systems, "held_names", list)
    counts: Counter[str] = Counter()

    def counted(name: str) -> Callable[..., Any]:
        real = getattr(systems, name)

        def call(*arguments: Any, **named: Any) -> Any:
            counts[name] += 1
            return real(*arguments, **named)

        return call

    for name in ("names_of", "running", "Segment"):
        monkeypatch.setattr(systems, name, counted(name))
    return counts


def test_the_remedy_for_systems_of_others_is_said_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(segment, "FOLDER", tmp_path)
    monkeypatch.setattr(systems, "held_names", list)
    theirs = {name: [f"/trocar~{name}~supervisor~document"] for name in ("one", "two")}
    monkeypatch.setattr(systems, "_named", lambda system=None, foreign=False: theirs if foreign else {})
    monkeypatch.setattr(systems, "other_owner", lambda system, ours: f"user {system}s")
    with pytest.raises(Problem, match="2 systems of other users are there; ") as found:
        systems.chosen_system()
    assert str(found.value).count(SERVICE_USER) == 1 and "user twos" not in str(found.value)


def test_the_system_meant_is_found_with_one_look(looks: Counter[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(systems, "those_up", lambda known: list(known)[:1])
    assert systems.chosen_system() == "old00"
    assert looks == {"names_of": 1}


def test_dead_systems_cost_one_attach_each(looks: Counter[str]) -> None:
    with pytest.raises(Problem, match=r"old00.*crashed and left shared memory"):
        systems.chosen_system()
    assert looks == {"names_of": 3, "running": 1, "Segment": DEAD}  # two more looks for those of other users


def test_a_named_system_asks_nobody_else(looks: Counter[str]) -> None:
    assert systems.chosen_system("old07") == "old07"
    assert looks == {"names_of": 2}


def test_what_is_left_over_is_asked_together(looks: Counter[str]) -> None:
    assert len(systems.left_over()) == DEAD
    assert looks == {"names_of": 1, "running": 2, "Segment": DEAD}


def test_a_system_whose_memory_is_out_of_reach_is_up_while_its_supervisor_runs(
        looks: Counter[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(systems, "held_names", lambda: ["port", "robot"])
    monkeypatch.setattr(systems, "running", lambda system=None: [
        RunningProcess("robot", "supervisor", os.getpid(), 1)])
    assert systems.chosen_system() == "robot" and systems.all_up() == ["robot"]
    monkeypatch.setattr(systems.owners, "accepted", lambda: frozenset({0, os.getuid()}))
    monkeypatch.setattr(systems.os, "getuid", lambda: 64103)
    with pytest.raises(Problem, match="no system is up"):  # it is being started, or ended, by another user
        systems.chosen_system()


def test_a_name_whose_processes_still_run_without_memory_is_taken(
        monkeypatch: pytest.MonkeyPatch, world: World) -> None:
    supervising.refuse_taken(world.name)
    left = [RunningProcess(world.name, "IO1", 42, 1)]
    monkeypatch.setattr(supervising, "running", lambda system: left)
    with pytest.raises(Problem, match=r"IO1 \(pid 42\); trocar down"):
        supervising.refuse_taken(world.name)


def test_logs_and_recordings_without_a_system_name_those_that_were_up_last(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path,
) -> None:
    monkeypatch.setenv("TROCAR_STATE", str(tmp_path))
    monkeypatch.setattr(systems, "all_up", list)
    for when, name in enumerate(("old", "newer")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "supervisor.log").write_text("")
        os.utime(tmp_path / name / "supervisor.log", (when, when))
    with pytest.raises(Problem, match=r"trocar logs IO1 --system NAME shows an earlier one: newer, old$"):
        logs.logs("IO1")
    with pytest.raises(Problem, match=r"trocar recordings --system NAME shows an earlier one: newer, old$"):
        recordings.recordings()
