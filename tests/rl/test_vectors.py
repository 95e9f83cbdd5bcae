"""Environments in processes of their own, however these are made: the same episodes, and nothing is left."""

from __future__ import annotations

import multiprocessing
import warnings

import gymnasium
import numpy as np
import psutil
import pytest

from procs.rl.backend import RobotStopped
from procs.rl.tasks import PsmReach
from shm.segment import FOLDER, names_of

pytestmark = pytest.mark.slow


def made() -> PsmReach:
    return PsmReach(starts=2, horizon=5)


@pytest.mark.parametrize("context", ["fork", "spawn"])
def test_each_process_plays_the_same_episode(context: str) -> None:
    ours = made()
    first, _ = ours.reset(seed=3, options={"start": 1})
    files, segments = set(FOLDER.iterdir()), set(names_of())
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", category=DeprecationWarning, message=".*fork.*")  # from Python 3.12 on
        vector = gymnasium.vector.AsyncVectorEnv([made] * 2, context=context)
    observations, _ = vector.reset(seed=[3, 3], options={"start": 1})
    np.testing.assert_array_equal(observations["observation"], [first["observation"]] * 2)
    for _ in range(5):
        action = np.full(7, 0.5, dtype=np.float32)
        expected = ours.step(action)
        observations, rewards, _, truncated, _ = vector.step(np.tile(action, (2, 1)))
        np.testing.assert_array_equal(observations["observation"], [expected[0]["observation"]] * 2)
        assert list(rewards) == [expected[1]] * 2
    assert truncated.all()
    vector.close()
    assert set(FOLDER.iterdir()) <= files and set(names_of()) == segments
    assert not [child for child in psutil.Process().children() if "resource_tracker" not in " ".join(child.cmdline())]
    ours.close()


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
