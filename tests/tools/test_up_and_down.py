"""Starting and stopping a system by the command line, with the real supervisor."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from trocar.procs.machine.paths import ROOT
from trocar.shm.memory.segment import SegmentError, names_of
from trocar.shm.time.control_page import ControlPage
from trocar.tools.systems.supervising import StartRequest


def trocar(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """A verb, its logs in `folder`."""
    environment = {**os.environ, "TROCAR_STATE": str(folder)}
    environment.pop("TROCAR_SYSTEM", None)
    return subprocess.run([sys.executable, "-m", "trocar", *words], cwd=ROOT, env=environment, capture_output=True,
                          text=True, timeout=120, check=False)


def beats(system: str) -> bool:
    """The supervisor has got to where it starts processes."""
    try:
        page = ControlPage(system, "supervisor")
    except SegmentError:
        return False
    state = page.state
    page.close()
    return state in ("STARTING", "RUNNING")


def test_options_are_passed_on_to_the_supervisor() -> None:
    request = StartRequest(Path("a.yaml"), "s", "emulated", (Path("p"), Path("q")), ("clock=wall",), 3.5)
    *words, room, spaces = request.command()[4:]
    assert room == "--room" and spaces.isspace()
    assert words == ["a.yaml", "--system", "s", "--boards", "emulated", "--path", "p", "--path", "q",
                     "--set", "clock=wall", "--for", "3.5"]


@pytest.mark.slow
def test_a_missing_file_stops_the_start(tmp_path: Path, world: Any) -> None:
    for detach in (["--detach"], []):
        done = trocar(tmp_path, "up", "nowhere.yaml", "--system", world.name, *detach)
        assert done.returncode == 1
        assert "nowhere.yaml" in done.stderr
        assert names_of(world.name) == []


@pytest.mark.slow
def test_a_detached_system_comes_up_and_goes_down(tmp_path: Path, world: Any) -> None:
    up = trocar(tmp_path, "up", "--detach", "--json", "--system", world.name)
    try:
        assert up.returncode == 0, up.stderr
        assert "emulated boards" in up.stderr
        pid = json.loads(up.stdout)["pid"]
        again = trocar(tmp_path, "up", "--detach", "--system", world.name)
        assert again.returncode == 1
        assert "is up already" in again.stderr
        logs = trocar(tmp_path, "logs", "supervisor", "--system", world.name, "--json")
        assert f"system {world.name} is up" in logs.stdout
    finally:
        down = trocar(tmp_path, "down", "--json", "--system", world.name)
    assert down.returncode == 0, down.stderr
    assert json.loads(down.stdout)["stopped"] == world.name
    assert names_of(world.name) == []
    assert not Path(f"/proc/{pid}").exists() or "Z" in Path(f"/proc/{pid}/stat").read_text()


@pytest.mark.slow
def test_the_demo_leaves_nothing_when_it_is_interrupted(tmp_path: Path, world: Any) -> None:
    environment = {**os.environ, "TROCAR_STATE": str(tmp_path)}
    demo = subprocess.Popen([sys.executable, "-m", "trocar", "demo", "--system", world.name], cwd=ROOT, env=environment,
                            stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    world.until(lambda: names_of(world.name), "the demo's shared memory")
    demo.send_signal(2)
    reported, _ = demo.communicate(timeout=90)
    assert names_of(world.name) == [], reported


@pytest.mark.slow
def test_the_demo_leaves_nothing_when_it_is_killed(tmp_path: Path, world: Any) -> None:
    environment = {**os.environ, "TROCAR_STATE": str(tmp_path)}
    demo = subprocess.Popen([sys.executable, "-m", "trocar", "demo", "--system", world.name], cwd=ROOT, env=environment,
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    world.until(lambda: beats(world.name), "the supervisor's beat")
    demo.kill()
    demo.wait(30)
    world.until(lambda: not names_of(world.name), "the supervisor removes its memory")
