"""tools/master.c, a master in C: what Python reads of it, and who else may have its place."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import trocar
from shm.clock import monotonic_ns
from tests.conftest import World
from tests.tools.client.test_provider import Place
from tests.tools.client.test_provider import made as made  # a fixture
from tests.tools.peeking import STRICT

pytestmark = [pytest.mark.slow, pytest.mark.alone]
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
    place = made(inputs=("clutch",))
    child = subprocess.Popen([program, place.name, "MTMR", "2.5"], text=True)
    world.children.append(child)
    world.until(lambda: place.ring.newest() and place.ring.sequence > 3, "it writes")
    assert abs(monotonic_ns() - place.ring.stamp_ns) < 1e9 and place.ring.epoch == 1
    assert place.value("program").item() == b"master.c" and place.value("state").item() == b"ENABLED"
    assert place.value("is_homed") and place.value("reference_valid") and not place.value("is_busy")
    with pytest.raises(TimeoutError, match=f"pid {child.pid}"):
        trocar.provide("MTMR", place.name, timeout=0.0)
    assert "another program is MTMR" in refused(program, place.name, "MTMR", "0.1")
    assert child.wait(30) == 0
    records = place.ring.last(100)
    pose, grippers = records["measured_cp"], place.ring.last(1000)["gripper_position"]
    assert len(records) > 10 and np.allclose(np.linalg.norm(pose[:, 3:], axis=1), 1.0)
    assert np.abs(np.diff(pose[:, :3], axis=0)).max() < 0.01 and grippers.max() > 0.8
    assert (records["measured_cv"][-1] != 0).any() and not place.ring.problem
    with trocar.provide("MTMR", place.name) as master:  # the kernel has given the place back
        master.write(np.eye(4))
        assert place.value("measured_cp").tolist() == [0, 0, 0, 0, 0, 0, 1] and place.ring.epoch == 2


def test_it_says_what_is_wrong_with_a_place(world: World, made: Callable[..., Place], program: Path) -> None:
    place = made()
    assert "is the system up?" in refused(program, place.name, "MTML")
    assert "PSM1 is not a place for a program of yours" in refused(program, place.name, "PSM1")
