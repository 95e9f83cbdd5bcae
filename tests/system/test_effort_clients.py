"""Clients of efforts that are killed, and a stream that stalls: what the emulated robot truly does."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from tests.system.conftest import systems
from tests.system.pushed import DEEP, EFFORT, FILE, POSITION, Pushed
from tests.system.robot import COARSE_ON_BOARDS, ROOT, TELEOP_AT_500_HZ, Robot, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.simulated("paced")]


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    with systems(tmp_path_factory.mktemp("efforts"), "paced") as make:
        robot = make()
        robot.up(FILE, *COARSE_ON_BOARDS, *TELEOP_AT_500_HZ)
        robot.home()
        yield robot


@pytest.fixture
def psm(running: Robot) -> Iterator[Pushed]:
    made = Pushed(running, "PSM1", DEEP)
    yield made
    made.close()


@pytest.fixture
def mtm(running: Robot) -> Iterator[Pushed]:
    made = Pushed(running, "MTMR", (0.0,) * 7)
    yield made
    made.close()


def test_the_efforts_of_a_killed_client_end(psm: Pushed) -> None:
    before = len(psm.reported("effort-timeout"))
    pusher = psm.pusher(0.3, 0, 0, 0, 0, 0)
    pusher.kill()
    pusher.wait()
    wait_for(lambda: psm.mode == POSITION, 30, "PSM1 holding after its client was killed")
    wait_for(lambda: len(psm.reported("effort-timeout")) > before, 30, "the reason")
    since = psm.now_ns() + 500_000_000
    wait_for(lambda: psm.now_ns() > since + 300_000_000, 60, "0.3 s of it")
    assert np.abs(psm.truth(since, "velocity"))[:, :3].max() < 0.02


def test_the_efforts_of_a_masters_killed_client_end_and_it_is_free(mtm: Pushed) -> None:
    pusher = mtm.pusher(0, 0, 0, 0, 0, 0, 0.005)
    pusher.kill()
    pusher.wait()
    wait_for(lambda: mtm.reported("effort-timeout"), 30, "the reason")
    assert mtm.mode == EFFORT
    wait_for(lambda: mtm.state.newest() and int(mtm.state.field("control_space")) == 2, 30, "Cartesian space")
    wait_for(lambda: mtm.state.newest() and np.abs(mtm.state.field("setpoint_effort")[6]) < 1e-4, 30, "no effort")


def test_a_stream_that_stalled_ends_and_does_not_jump(running: Robot, psm: Pushed, tmp_path: Path) -> None:
    angle = 2.0 * np.pi * np.arange(4000) / 200.0 / 4.0  # 0.25 Hz
    rows = np.tile(DEEP, (len(angle), 1))
    rows[:, 0] = 0.5 * np.sin(angle)
    np.savetxt(tmp_path / "sine.csv", rows, delimiter=",")
    command = [sys.executable, "-m", "trocar", "stream", "PSM1", str(tmp_path / "sine.csv"), "--rate", "200"]
    stream = subprocess.Popen(command, cwd=ROOT, env=running.environment, stdout=subprocess.PIPE,
                              stderr=subprocess.STDOUT, text=True)
    wait_for(lambda: psm.truth(psm.now_ns() - 50_000_000, "velocity")[:, 0].max() > 0.5, 60, "PSM1 moved by the stream")
    os.kill(stream.pid, signal.SIGSTOP)
    psm.wait_ns(500_000_000)
    since = psm.now_ns()
    os.kill(stream.pid, signal.SIGCONT)
    reported, _ = stream.communicate(timeout=60)
    assert stream.returncode == 1 and "stalled for " in reported, reported
    psm.wait_ns(1_000_000_000)
    assert np.abs(psm.truth(since, "velocity")[:, 0]).max() < 0.1, "a jump"
    assert psm.mode == POSITION
