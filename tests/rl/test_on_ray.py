"""Episodes on Ray are those that run here, bit by bit; nothing of Ray is left behind. tools/peers installs it."""

from __future__ import annotations

import json
import os
import subprocess
import tempfile
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest

from tests.system.robot import ROOT, wait_for

PYTHON = ROOT / ".venv-ray" / "bin" / "python"
pytestmark = [pytest.mark.peers, pytest.mark.slow,
              pytest.mark.skipif(not PYTHON.exists(), reason="no Ray: tools/peers installs it")]
REACH = ("trocar/PsmReach-v0", "--option", "backend=boards", "--option", "horizon=10", "--episodes", "6")
CART = ("CartPole-v1", "--episodes", "2")
FILE = "policies.py"
FAILING = """
import os

class Fails:
    def __call__(self, observation):
        raise ValueError("nothing learned")

class Dies:
    def __call__(self, observation):
        os._exit(3)
"""


@pytest.fixture
def folder() -> Iterator[Path]:
    """Home and temporary folder in one, of a short name, as sockets lie in it; fails when something of Ray is left."""
    before = processes()
    with tempfile.TemporaryDirectory(prefix="t") as name:
        yield Path(name)
        wait_for(lambda: processes() <= before, 30.0, "Ray's processes to end")
        assert {path.name for path in Path(name).iterdir()} <= {FILE}


def processes() -> set[int]:
    names = ((each.pid, each.info["name"] or "") for each in psutil.process_iter(["name"]))
    return {pid for pid, name in names if name.startswith(("raylet", "gcs_server", "ray::"))}


def rollout(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(PYTHON), "-m", "trocar", "rl", "rollout", *words, "--json"], cwd=ROOT, text=True, capture_output=True,
        timeout=240, check=False, env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1",
                                       "TMPDIR": str(folder), "HOME": str(folder)})


def test_who_ends_it_from_outside_leaves_nothing(folder: Path) -> None:
    words = [str(PYTHON), "-m", "trocar", "rl", "rollout", "CartPole-v1", "-n", "1000000", "--actors", "1", "--json"]
    with subprocess.Popen(words, cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL,
                          env={**os.environ, "TMPDIR": str(folder), "HOME": str(folder)}) as process:
        assert process.stdout is not None and process.stdout.readline().startswith('{"seed"')
        process.terminate()
        process.stdout.read()
        assert process.wait(60.0) == 130


def hashes(done: subprocess.CompletedProcess[str]) -> dict[int, str]:
    assert done.returncode == 0, done.stderr
    rows = [json.loads(line) for line in done.stdout.splitlines()][:-1]
    return {row["seed"]: row["hash"] for row in rows}


def test_actors_do_what_is_done_here(folder: Path) -> None:
    here, there = hashes(rollout(folder, *REACH)), hashes(rollout(folder, *REACH, "--actors", "2"))
    assert there == here and sorted(here) == list(range(6)) and len(set(here.values())) == 6


@pytest.mark.parametrize(("policy", "wrong"), [("Fails", "policies.py:Fails failed: ValueError: nothing learned"),
                                               ("Dies", "was lost")])
def test_what_goes_wrong_in_an_actor_is_told(folder: Path, policy: str, wrong: str) -> None:
    file = folder / FILE
    file.write_text(FAILING)
    done = rollout(folder, *CART, "--actors", "1", "--policy", f"{file}:{policy}")
    assert (done.returncode, done.stdout) == (1, "")
    assert wrong in done.stderr.splitlines()[-1]


def test_a_cluster_that_is_not_there_is_told_at_once(folder: Path) -> None:
    done = rollout(folder, *CART, "--actors", "1", "--address", "127.0.0.1:1")
    assert done.returncode == 1 and "Connection refused" in done.stderr
