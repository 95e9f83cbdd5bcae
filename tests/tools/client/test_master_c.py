"""tools/master.c, a master in C: what Python reads of it, and who else may have its place."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import trocar
from tests.conftest import World
from tests.tools.client.test_provider import Place
from tests.tools.client.test_provider import made as made  # a fixture
from tests.tools.peeking import STRICT
from trocar.shm.time.clock import monotonic_ns

pytestmark = pytest.mark.slow
SOURCE = Path(__file__).resolve().parents[3] / "tools" / "master.c"


@pytest.fixture
def program(tmp_path: Path) -> Path:
    gcc = shutil.which("gcc")
    if gcc is None:
        pytest.skip("there is no gcc on this machine")
    done = subprocess.run([gcc, *STRICT, "-o", str(tmp_path / "master"), str(SOURCE), "-lm"], capture_output=True,
                          text=True, check=False)
    assert done.returncode == 0 and not done.stderr, done.stderr
    return tmp_path / "master"


def refused(program: Path, *words: str) -> str:
    done = subprocess.run([program, *words], capture_output=True, text=True, timeout=30, check=False)
    assert done.returncode == 1
    return done.stderr


def test_a_program_in_c_is_a_master(world: World, made: Callable[..., Place], program: Path) -> None:
    place, before_ns = made(inputs=("clutch",)), monotonic_ns()
    child = subprocess.Popen([program, place.name, "MTMR", "600"], text=True)
    world.children.append(child)
    world.until(lambda: place.ring.newest() and place.ring.sequence > 3, "it writes")
    begin_ns = place.ring.stamp_ns
    assert before_ns <= begin_ns <= monotonic_ns() and place.ring.epoch == 1
    assert place.value("program").item() == b"master.c" and place.value("state").item() == b"ENABLED"
    assert place.value("is_homed") and place.value("reference_valid") and not place.value("is_busy")
    with pytest.raises(TimeoutError, match=f"pid {child.pid}"):
        trocar.provide("MTMR", place.name, timeout=0.0)
    assert "another program is MTMR" in refused(program, place.name, "MTMR", "0.1")
    world.until(lambda: place.ring.newest() and place.ring.stamp_ns > begin_ns + 2_500_000_000, "it moves")
    records = place.ring.last(1000)
    pose, passed_s = records["measured_cp"], (records["stamp_ns"] - records["stamp_ns"][0]) * 1e-9
    assert len(records) > 4 and np.allclose(np.linalg.norm(pose[:, 3:], axis=1), 1.0)
    steps, most = np.abs(np.diff(pose[:, :3], axis=0)), 0.021 * np.diff(passed_s) + 1e-6
    assert (steps <= most[:, np.newaxis]).all()
    if records["sequence"][0] == 1:  # else we had no core for so long that the begin was overwritten
        assert (records["gripper_position"][np.abs(passed_s - 1.0) < 0.1] > 0.8).all()
    assert (records["measured_cv"][-1] != 0).any() and not place.ring.problem
    child.terminate()
    child.wait(30)
    assert subprocess.run([program, place.name, "MTMR", "0.01"], timeout=30, check=False).returncode == 0
    with trocar.provide("MTMR", place.name) as master:  # the kernel has given the place back
        master.write(np.eye(4))
        assert place.value("measured_cp").tolist() == [0, 0, 0, 0, 0, 0, 1] and place.ring.epoch == 3


def test_it_says_what_is_wrong_with_a_place(world: World, made: Callable[..., Place], program: Path) -> None:
    place = made()
    assert "is the system up?" in refused(program, place.name, "MTML")
    assert "PSM1 is not a place for your own program" in refused(program, place.name, "PSM1")
