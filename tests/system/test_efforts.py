"""Efforts that ask for too much or never stop, and a stream across a gap: what the emulated robot truly does."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from tests.system.conftest import systems
from tests.system.pushed import DEEP, FILE, POSITION, Pushed
from tests.system.robot import TELEOP_AT_500_HZ, Robot, wait_for
from tests.system.robot_in_host import HOSTED

pytestmark = [pytest.mark.slow, pytest.mark.simulated(HOSTED)]


@pytest.fixture(scope="module")
def running(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    with systems(tmp_path_factory.mktemp("efforts"), HOSTED) as make:
        robot = make()
        robot.up(FILE, *TELEOP_AT_500_HZ)
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


def test_more_than_the_motors_give_is_clipped_and_said(running: Robot, psm: Pushed) -> None:
    reported = running.trocar("send", "PSM1", "servo_jf", "1e6", *"00000")
    assert reported.strip() == "done, clipped: yaw"
    assert "1000 N" in running.trocar("send", "PSM1", "body/servo_cf", "0", "0", "1e6", *"000", code=1)
    wait_for(lambda: psm.mode == POSITION, 30, "the effort of a single command ended")


@pytest.mark.usefixtures("running")  # before the test, which asks for one of its arms only
@pytest.mark.parametrize("which", ("psm", "mtm"))
def test_a_constant_effort_keeps_below_the_speed_limit_and_stops_before_the_joint_limit(
    which: str, request: pytest.FixtureRequest
) -> None:
    arm: Pushed = request.getfixturevalue(which)
    space, count = arm.space, arm.space.count
    efforts = np.zeros(count)
    efforts[:3] = space.rated[:3]
    for side in (1.0, -1.0):
        velocity, place = arm.push(side * efforts)
        speed = np.abs(velocity)
        share = (speed / space.effort_speed)[:, :3].max(axis=0)
        assert (share < 1.2).all(), f"speeds {share} of the limits, to side {side}"
        assert (share > 0.7).any(), "and it was pushed"
        beyond = np.maximum(place - space.upper, space.lower - place)[:, :3].max(axis=0)
        assert (beyond <= 0.0).all(), f"{beyond} beyond the limits"
        zone = space.effort_zone[:3]
        near = np.where(side > 0.0, space.upper[:3] - place[-1, :3], place[-1, :3] - space.lower[:3])
        assert (near < zone).any() and speed[-200:, :3].max() < 0.05, "at rest at the wall"
    arm.remote.ask("hold")


def test_a_stream_of_another_program_is_not_followed_across_a_gap(psm: Pushed) -> None:
    for k in range(50):
        psm.remote.ask("servo_jp", (0.002 * k, *DEEP[1:]))
    psm.wait_ns(500_000_000)
    since = psm.now_ns()
    answer = psm.remote.answered("servo_jp", (0.6, *DEEP[1:]))
    assert answer.outcome == "refused" and "move there first" in answer.text
    psm.wait_ns(500_000_000)
    assert np.abs(psm.truth(since, "velocity")[:, 0]).max() < 0.1
