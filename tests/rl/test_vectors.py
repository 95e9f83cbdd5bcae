"""Environments in processes of their own, however these are made: the same episodes, and nothing is left."""

from __future__ import annotations

import multiprocessing
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from trocar.procs.rl.backend import RobotStopped
from trocar.procs.rl.tasks import PsmReach
from trocar.shm.memory.segment import FOLDER

pytestmark = pytest.mark.slow
ROOT = Path(__file__).resolve().parents[2]


def made() -> PsmReach:
    return PsmReach(starts=2, horizon=5)


PLAYED = """
import functools, warnings
import gymnasium, numpy, psutil
from trocar.procs.rl.tasks import PsmReach
made = functools.partial(PsmReach, starts=2, horizon=5)
ours = made()
first, _ = ours.reset(seed=3, options={"start": 1})
with warnings.catch_warnings():
    warnings.filterwarnings("ignore", category=DeprecationWarning, message=".*fork.*")  # from Python 3.12 on
    vector = gymnasium.vector.AsyncVectorEnv([made] * 2, context=CONTEXT)
seen, _ = vector.reset(seed=[3, 3], options={"start": 1})
numpy.testing.assert_array_equal(seen["observation"], [first["observation"]] * 2)
for _ in range(5):
    action = numpy.full(7, 0.5, dtype=numpy.float32)
    expected = ours.step(action)
    seen, rewards, _, truncated, _ = vector.step(numpy.tile(action, (2, 1)))
    numpy.testing.assert_array_equal(seen["observation"], [expected[0]["observation"]] * 2)
    assert list(rewards) == [expected[1]] * 2
assert truncated.all()
vector.close()
left = [" ".join(child.cmdline()) for child in psutil.Process().children()]
print("left:", *[command for command in left if "resource_tracker" not in command])
"""


@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_each_process_plays_the_same_episode(context: str) -> None:
    with subprocess.Popen([sys.executable, "-c", f"CONTEXT = {context!r}\n{PLAYED}"], cwd=ROOT, text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE,
                          env={**os.environ, "PYTHONPATH": str(ROOT)}) as process:
        out, errors = process.communicate(timeout=120)
    assert process.returncode == 0, errors
    assert out.strip() == "left:"
    assert not [file for file in FOLDER.iterdir() if re.search(rf"~rl{process.pid}x", file.name)]


def test_a_forked_child_cannot_go_on_with_what_is_its_parent_s() -> None:
    env = made()
    first, _ = env.reset(seed=3, options={"start": 1})
    receiver, sender = multiprocessing.get_context("fork").Pipe(duplex=False)

    def child() -> None:
        try:
            env.reset()
        except RobotStopped as stopped:
            sender.send(str(stopped))
        env.close()

    process = multiprocessing.get_context("fork").Process(target=child)
    process.start()
    assert receiver.poll(30.0) and "made by the process that forked us" in receiver.recv()
    process.join(30.0)
    assert process.exitcode == 0
    again, _ = env.reset(seed=3, options={"start": 1})
    np.testing.assert_array_equal(again["observation"], first["observation"])
    env.close()
