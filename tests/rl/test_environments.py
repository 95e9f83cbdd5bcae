"""Episodes in environments on a host: the same bit by bit, whatever went before, and as Gymnasium wants them."""

from __future__ import annotations

import os
import pickle
import warnings
from collections.abc import Iterator
from pathlib import Path
from types import MappingProxyType
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from tests.rl.playing import drawn, toward
from trocar.procs.native.library import native
from trocar.procs.rl.backend import RobotStopped
from trocar.procs.rl.environment import RobotEnv
from trocar.procs.rl.hand_over import FIRST, SECOND, PsmHandOver
from trocar.procs.rl.hosted import HostedRobot, document
from trocar.procs.rl.push import PsmPush
from trocar.procs.rl.tasks import EcmAim, PsmReach, PsmTrack
from trocar.shm.memory.segment import names_of

TASKS = (PsmReach, PsmTrack, EcmAim, PsmHandOver, PsmPush)


def ours() -> set[tuple[str, str, str]]:
    """Segments of systems of environments."""
    return {name for name in names_of() if name[0].startswith(f"rl{os.getpid()}x")}


@pytest.fixture(scope="module")
def reach() -> Iterator[PsmReach]:
    env = PsmReach(starts=2)
    yield env
    env.close()


@pytest.fixture(scope="module")
def boards() -> Iterator[PsmReach]:
    env = PsmReach(backend="boards", starts=2)
    yield env
    env.close()


@pytest.mark.parametrize("task", TASKS)
def test_gymnasium_finds_nothing_wrong_with_it(task: type[RobotEnv]) -> None:
    env = task(starts=1)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*alternative render modes.*")  # has tests of its own
        check_env(env, skip_render_check=True)
    assert len(env.contents) == len(env.reset()[0]["observation"])
    env.close()
    env.close()


@pytest.mark.skipif(native().library is None, reason=f"no native library: {native().why}")
def test_an_arm_with_walls_slides_along_them_in_every_episode_alike() -> None:
    with pytest.raises(ValueError, match="cube"):
        PsmReach(walls=[{"name": "floor", "shape": "cube"}])
    with pytest.raises(ValueError, match="its own"):
        PsmReach(backend="attached", walls=[{"name": "floor", "shape": "plane"}])
    plain = PsmReach(starts=1)
    height = plain.robot.models[0].middle[2] - 0.01
    plain.close()
    env = PsmReach(starts=1, walls=[{"name": "floor", "shape": "plane", "position": [0.0, 0.0, height], "of": "tip"}])
    tips = []
    for _ in range(2):
        env.reset(seed=1)
        for _ in range(15):
            info = env.step(np.array((0.3, 0.0, -1.0, 0.0, 0.0, 0.0, 0.0)))[-1]
            tips.append(env.tips[0].copy())
        assert info["at_wall"] == "PSM1: floor" and not info["fault"] and not info["refused"]
    env.close()
    assert min(tip[2] for tip in tips) > height - 1e-6 and tips[14][0] > tips[0][0] + 0.005
    np.testing.assert_array_equal(tips[:15], tips[15:])


@pytest.mark.slow
@pytest.mark.usefixtures("fresh")
def test_episodes_are_the_same_in_any_environment_and_order() -> None:
    one, other = PsmReach(starts=2), PsmReach(starts=2)
    first = drawn(one, 5, 12)
    drawn(one, 6, 5, start=0)
    assert drawn(one, 5, 12) == first == drawn(other, 5, 12)
    assert drawn(other, 7, 12) != first
    one.close()
    other.close()


@pytest.mark.slow
def test_episodes_on_boards_are_the_same_also_out_of_an_emergency_stop(boards: PsmReach) -> None:
    first = drawn(boards, 5, 12)
    boards.reset(seed=8)
    robot = boards.robot
    assert isinstance(robot, HostedRobot) and robot.host is not None
    robot.host.client("boards").send("emergency_stop", (1.0,))
    info: dict[str, Any] = {}
    for _ in range(20):
        _, _, terminated, _, info = boards.step(np.zeros(7))
        if terminated:
            break
    assert terminated and info["state"] == "FAULT" and "PSM1 is FAULT" in info["fault"], info
    assert not info["is_success"]
    assert drawn(boards, 5, 12) == first


@pytest.mark.slow
def test_time_truncates_and_a_goal_that_is_reached_does_not_end_it(reach: PsmReach) -> None:
    observation, info = reach.reset(seed=3)
    first_m, ends = info["distance_m"], []
    for _ in range(reach.horizon):
        observation, reward, terminated, truncated, info = reach.step(toward(observation, 7))
        ends.append((terminated, truncated))
    assert ends == [(False, False)] * (reach.horizon - 1) + [(False, True)]
    assert info["is_success"] and info["distance_m"] < 1e-3 < first_m
    assert reward == -info["distance_m"] and info["time_s"] == pytest.approx(5.0)


def test_each_goal_and_start_can_be_had_and_is_within_reach(reach: PsmReach) -> None:
    goals = np.array([reach.reset(seed=seed)[0]["desired_goal"] for seed in range(50)])
    away = np.linalg.norm(goals - reach.robot.models[0].middle, axis=1)
    assert 0.02 < away.max() <= 0.035 and away.min() < 0.02
    np.testing.assert_array_equal(reach.reset(options={"goal": (0.01, 0.0, -0.1)})[0]["desired_goal"],
                                  (0.01, 0.0, -0.1))
    places = [reach.reset(options={"start": start})[0]["observation"][:6] for start in (0, 1)]
    starts = reach.robot.models[0].starts()
    np.testing.assert_allclose(places, [start.joints for start in starts[:2]], atol=1e-6)


def test_rewards_are_for_many_goals_at_a_time(reach: PsmReach) -> None:
    achieved, desired = np.zeros((4, 5, 3)), np.full((4, 5, 3), 0.01)
    np.testing.assert_allclose(reach.compute_reward(achieved, desired, {}), np.full((4, 5), -0.01 * 3**0.5))
    sparse = PsmReach(reward="sparse")
    assert sparse.compute_reward(np.zeros(3), np.array((0.004, 0.0, 0.0)), {}) == 0.0
    np.testing.assert_array_equal(sparse.compute_reward(achieved, desired, {}), np.full((4, 5), -1.0))
    over = PsmHandOver()
    assert over.compute_reward(np.zeros(4), np.array((0.0, 0.0, 0.0, 1.0)), {}) == -0.1


@pytest.mark.slow
def test_noise_is_of_the_seed_and_not_in_what_counts_as_success() -> None:
    env = PsmReach(noise_m=0.002, starts=1)
    one, info = env.reset(seed=4)
    other, _ = env.reset(seed=4)
    np.testing.assert_array_equal(one["achieved_goal"], other["achieved_goal"])
    really = env.seen_pose(0)[:3]
    assert 1e-5 < np.linalg.norm(one["achieved_goal"] - really) < 0.02
    assert info["distance_m"] == np.linalg.norm(really - one["desired_goal"])
    env.close()


def test_a_goal_moves_smoothly_and_its_velocity_is_told() -> None:
    env = PsmTrack(starts=1)
    observation, _ = env.reset(seed=2)
    for _ in range(5):
        before = observation
        observation, *_ = env.step(toward(observation, 7))
        moved = (observation["desired_goal"] - before["desired_goal"]) / env.period_s
        told = 0.5 * (observation["observation"][-3:] + before["observation"][-3:])
        np.testing.assert_allclose(moved, told, atol=1e-4)
    assert np.abs(told).max() < 0.02
    env.close()


@pytest.mark.slow
def test_an_endoscope_looks_at_its_goal() -> None:
    env = EcmAim(starts=1, horizon=60)
    observation, info = env.reset(seed=2)
    for _ in range(60):
        action = np.zeros(6)
        action[:3] = np.clip((observation["desired_goal"] - observation["achieved_goal"]) / 0.002, -1.0, 1.0)
        observation, _, _, _, info = env.step(action)
    assert info["is_success"], info
    env.close()


@pytest.mark.slow
def test_a_peg_is_handed_over_and_falls_when_nobody_holds_it() -> None:
    env = PsmHandOver(starts=1, horizon=300)
    env.reset(seed=3)
    seen = []
    for _ in range(150):
        action, (grips, _) = np.zeros(14), env.grips()
        peg, holders = env.peg.pose[:3, 3], list(env.peg.holders)
        seen += [holders] if holders not in seen else []
        if holders == [FIRST]:
            action[7:10] = np.clip((peg - grips[SECOND][:3, 3]) / 0.002, -1.0, 1.0)
            action[13] = -1.0 if np.linalg.norm(peg - grips[SECOND][:3, 3]) < 0.002 else 0.0
        elif holders == [FIRST, SECOND]:
            action[6] = 1.0
        else:
            action[7:10] = np.clip((env.goal[:3] - peg) / 0.002, -1.0, 1.0)
        _, _, _, _, info = env.step(action)
        if info["is_success"]:
            break
    assert info["is_success"] and seen == [[FIRST], [FIRST, SECOND], [SECOND]], (seen, info)
    for _ in range(4):
        observation, *_ = env.step(np.array((*np.zeros(13), 1.0)))
    assert not env.peg.holders and observation["achieved_goal"][2] < -0.04 and observation["achieved_goal"][3] == 0.0
    assert env.reset(seed=3)[0]["achieved_goal"][2] > -0.04
    env.close()


@pytest.mark.parametrize(("options", "told"), [
    ({"backend": "real"}, "backend is 'real'; allowed: 'kinematic', 'boards', 'attached'"),
    ({"control": "torque"}, "control is 'torque'; allowed: 'joint', 'cartesian'"),
    ({"policy_hz": 5}, "policy_hz is 5; allowed: 10 to 50"),
    ({"policy_hz": 30}, "has to be a multiple of policy_hz, 30"),
    ({"speed": float("nan")}, "speed is nan; allowed: 0.01 to 1.0"),
    ({"speed": "fast"}, "speed is 'fast'; allowed: 0.01 to 1.0"),
    ({"policy_hz": 12.5}, "policy_hz is 12.5; allowed: 10 to 50, a whole number"),
    ({"horizon": 1.5}, "horizon is 1.5; allowed: 1 to 1000000, a whole number"),
    ({"backend": "boards", "physics_s": 0.004}, "physics_s is 0.004 s; allowed: 0.0005 to 0.002 s"),
    ({"period_s": 0.01}, "period_s is 0.01 s; allowed: 0.0005 to 0.002 s"),
    ({"render_mode": "human"}, "render_mode is 'human'")])
def test_what_cannot_be_is_refused_with_what_can(options: dict[str, Any], told: str) -> None:
    with pytest.raises(ValueError, match=told):
        PsmReach(**options)


def test_wrong_options_are_refused(reach: PsmReach) -> None:
    with pytest.raises(ValueError, match="start is 99; allowed: 0 to 7"):
        reach.reset(options={"start": 99})
    with pytest.raises(ValueError, match="options have strt; allowed: start, goal"):
        reach.reset(options={"strt": 1})
    with pytest.raises(ValueError, match="the goal of PsmTrack is chosen by the environment; none can be given"):
        PsmTrack().reset(options={"goal": (0.0, 0.0, -0.1)})
    with pytest.raises(ValueError, match="a goal is 3 numbers"):
        reach.reset(options={"goal": (0.0, np.inf, 0.0)})


def test_the_task_on_the_page_can_be_played() -> None:
    page = (Path(__file__).resolve().parents[2] / "docs" / "simulation.md").read_text(encoding="utf-8")
    code = page.split("## A task of one's own")[1].split("```python\n")[1].split("```")[0]
    exec(code, {"__name__": "page"})
    env = gymnasium.make("mine/Circle-v0", starts=1)
    first, _ = env.reset(seed=1, options={"start": 1})
    assert 0.01 <= first["observation"][-1] <= 0.03
    again, info = env.reset(seed=1, options={"start": 1})
    assert again["observation"].tobytes() == first["observation"].tobytes() and info["distance_m"] > 0.0
    assert not env.step(env.action_space.sample())[4]["fault"]
    env.close()
    del gymnasium.registry["mine/Circle-v0"]


@pytest.mark.slow
def test_an_episode_begins_with_reset() -> None:
    env = PsmReach(starts=1)
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(7))
    env.close()


@pytest.mark.slow
def test_pickled_it_is_made_anew(reach: PsmReach) -> None:
    first = drawn(reach, 5, 3)
    again = pickle.loads(pickle.dumps(reach))
    assert isinstance(again, PsmReach) and again.robot is not reach.robot
    assert drawn(again, 5, 3) == first
    again.close()


class NearReach(PsmReach):
    """With an argument of its own."""

    def __init__(self, near_m: float, **options: Any) -> None:
        super().__init__(**options)
        self.near_m = near_m


def test_pickled_it_keeps_what_its_own_class_takes() -> None:
    again = pickle.loads(pickle.dumps(NearReach(0.01, horizon=7)))
    assert isinstance(again, NearReach) and (again.near_m, again.horizon) == (0.01, 7)
    again.close()


class CartReach(PsmReach):
    """On an arm whose base its setup joints carry; nobody has homed these."""

    FILES = MappingProxyType({"kinematic": "kinematic-cart.yaml"})


@pytest.mark.slow
def test_an_arm_whose_base_nobody_knows_is_not_begun_with() -> None:
    env = CartReach(starts=1)
    with pytest.raises(RobotStopped, match="PSM1 is ENABLED: its base frame is not known"):
        env.reset()
    with pytest.raises(gymnasium.error.ResetNeeded):
        env.step(np.zeros(7))
    env.close()


@pytest.mark.slow
def test_what_is_no_action_is_refused_and_a_closed_environment_stays_closed() -> None:
    env = PsmReach(starts=1, render_mode="rgb_array")
    env.reset(seed=1)
    for given in (np.zeros((1, 7)), np.zeros(6), "hello", ["a"] * 7, [[1.0], [1.0, 2.0]], None, np.full(7, np.nan)):
        with pytest.raises(ValueError, match="an action is 7 finite numbers, not "):
            env.step(given)  # type: ignore[arg-type]
    env.step(np.zeros(7))
    env.close()
    for act in (env.reset, lambda: env.step(np.zeros(7)), env.render):
        with pytest.raises(gymnasium.error.ClosedEnvironmentError, match="make a new one"):
            act()


@pytest.mark.slow
def test_an_arm_that_has_failed_stays_where_it_was_seen_noise_and_all() -> None:
    env = PsmReach(backend="boards", noise_m=0.002, starts=1)
    env.reset(seed=4)
    assert env.robot.host is not None
    env.robot.host.client("boards").send("emergency_stop", (1.0,))
    while not env.step(np.zeros(7))[2]:
        pass
    before = env.tips.copy()
    assert env.step(np.zeros(7))[2] and (env.tips == before).all()
    env.close()


@pytest.mark.slow
@pytest.mark.usefixtures("fresh")
def test_several_are_stepped_side_by_side_and_leave_nothing() -> None:
    before = ours()
    vector = gymnasium.vector.SyncVectorEnv([lambda: PsmReach(starts=1, horizon=3)] * 2)
    observations, _ = vector.reset(seed=[1, 1])
    for _ in range(4):
        observations, rewards, _, _, infos = vector.step(np.zeros((2, 7)))
    assert rewards[0] == rewards[1] and observations["observation"].shape == (2, 22) and "is_success" in infos
    vector.close()
    assert ours() == before


def test_a_system_of_ours_has_a_name_of_its_own() -> None:
    assert document("kinematic.yaml", "kinematic", 0.002, 0.002).name != document(
        "kinematic.yaml", "kinematic", 0.002, 0.002).name
