"""Systems that start where /dev/shm is a small file system of its own, as in a container."""

from __future__ import annotations

import dataclasses
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.system.robot import DEMO, ROOT
from tests.system.test_memory import system as system  # a fixture
from trocar.procs.document.system import SystemConfig
from trocar.procs.supervisor import memory

pytestmark = [pytest.mark.patient, pytest.mark.slow]
IN_A_SMALL_ONE = """
mount -t tmpfs -o size={size} tmpfs /dev/shm || exit 99
{command}
code=$?
echo "left: $(ls -A /dev/shm)"
exit $code
"""


def in_small_memory(size: int, command: str, state: Path) -> subprocess.CompletedProcess[str]:
    """Run a command where /dev/shm is a small file system of its own."""
    allowed = subprocess.run(["unshare", "-m", "--propagation", "private", "true"], capture_output=True, check=False)
    if allowed.returncode:
        pytest.skip("a mount namespace of one's own is not permitted here")
    script = IN_A_SMALL_ONE.format(size=size, command=command)
    done = subprocess.run(["unshare", "-m", "--propagation", "private", "sh", "-c", script], cwd=ROOT, text=True,
                          capture_output=True, timeout=120, check=False, env={**os.environ, "TROCAR_STATE": str(state)})
    if done.returncode == 99:
        pytest.skip("mounting is not permitted here")
    return done


def test_up_in_a_full_shared_memory_says_what_to_do(system: SystemConfig, tmp_path: Path) -> None:
    up = f"{sys.executable} -m trocar up {DEMO} --system {system.name} --clock wall --for 0.1"
    done = in_small_memory(8 << 20, up, tmp_path)
    assert done.returncode == 1, done.stderr
    assert f"shared memory is full: system {system.name} needs " in done.stderr and "8.4 MB are free" in done.stderr
    assert "Traceback" not in done.stderr and done.stdout == "left: \n"


@pytest.mark.parametrize("file", ["demo-teleop", "demo", "kinematic-full"])
def test_the_examples_fit_into_a_container_without_options(file: str, world: Any, tmp_path: Path) -> None:
    up = (f"{sys.executable} -m trocar up configs/systems/{file}.yaml --boards emulated --system {world.name} "
          "--clock paced --for 0.1")
    done = in_small_memory(64 << 20, up, tmp_path)
    assert done.returncode == 0 and "rings keep" not in done.stderr and done.stdout == "left: \n", done.stderr


def test_up_and_status_say_that_rings_keep_less(system: SystemConfig, tmp_path: Path) -> None:
    trocar = f"{sys.executable} -m trocar"
    verbs = (f"up {DEMO} --clock paced --detach", "status", "down")
    done = in_small_memory(16 << 20, "\n".join(f"{trocar} {verb} --system {system.name}" for verb in verbs), tmp_path)
    assert done.returncode == 0, done.stderr
    found = re.findall(r"rings keep ([\d.]+) s instead of 1.87 s: 16.8 MB of shared memory were free", done.stderr)
    shown = re.findall(r"rings keep ([\d.]+) s", done.stdout)
    assert len(found) == len(shown) == 1 and found == shown and 0.2 <= float(found[0]) < 1.87
    assert done.stdout.endswith("left: \n")


def test_up_fits_into_exactly_what_it_says(system: SystemConfig, tmp_path: Path) -> None:
    needed = memory.needed(dataclasses.replace(system, clock="paced"))
    up = f"{sys.executable} -m trocar up {DEMO} --system {system.name} --clock paced --for 0.1"
    done = in_small_memory(needed + memory.RESERVE, up, tmp_path)
    assert done.returncode == 0, done.stderr
    assert f"system {system.name}: {needed / 1e6:.1f} MB of shared memory" in done.stderr
    assert done.stdout == "left: \n"


def test_memory_another_program_takes_meanwhile_is_no_harm(tmp_path: Path, world: Any) -> None:
    code = ('from trocar.procs.config import load_system; from trocar.procs.supervisor import memory\n'
            'memory.free_bytes = lambda system: 1 << 40\n'
            f'memory.create_all(load_system("{DEMO}", name="{world.name}").system)')
    done = in_small_memory((1 << 20) + 8192, f"{sys.executable} -c '{code}'", tmp_path)
    assert "SegmentFull: shared memory is full: system" in done.stderr and done.stdout == "left: \n"
