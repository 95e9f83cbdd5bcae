"""Environments in processes of their own, however these are made: the same episodes, and nothing is left."""

from __future__ import annotations

import multiprocessing
import re
import subprocess
import sys

import numpy as np
import pytest

from tests.rl.test_registration import NO_PICTURES, ROOT
from trocar.procs.rl.backend import RobotStopped
from trocar.procs.rl.tasks import PsmReach
from trocar.shm.memory.segment import FOLDER

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("fresh")]


def made() -> PsmReach:
    return PsmReach(starts=2, horizon=5)


PLAYED = """
import functools, warnings
import gymnasium, numpy, psutil
from trocar.procs.rl.tasks import PsmReach
made = functools.partial(PsmReach, starts=2, horizon=5)
ours, action = made(), numpy.full(7, 0.5, dtype=numpy.float32)
first, _ = ours.reset(seed=3, options={"start": 1})
steps = [ours.step(action) for _ in range(5)]
for context, count in ("fork", 2), ("spawn", 1):
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", category=DeprecationWarning, message=".*fork.*")  # from Python 3.12 on
        vector = gymnasium.vector.AsyncVectorEnv([made] * count, context=context)
    seen, _ = vector.reset(seed=[3] * count, options={"start": 1})
    numpy.testing.assert_array_equal(seen["observation"], [first["observation"]] * count)
    for expected in steps:
        seen, rewards, _, truncated, _ = vector.step(numpy.tile(action, (count, 1)))
        numpy.testing.assert_array_equal(seen["observation"], [expected[0]["observation"]] * count)
        assert list(rewards) == [expected[1]] * count
    assert truncated.all()
    vector.close()
left = [" ".join(child.cmdline()) for child in psutil.Process().children()]
print("left:", *[command for command in left if "resource_tracker" not in command])
"""


def test_each_process_plays_the_same_episode_forked_or_spawned() -> None:
    with subprocess.Popen([sys.executable, "-c", PLAYED], cwd=ROOT, text=True, stdout=subprocess.PIPE,
                          stderr=subprocess.PIPE, env=NO_PICTURES) as process:
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
