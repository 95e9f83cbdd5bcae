"""A block on a table is pushed by closed jaws: contact, friction and weight beside the real stack."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.rl.playing import drawn
from trocar.procs.rl.push import BLOCK, PsmPush
from trocar.procs.rl.scene import DARK, Drawn, rod

Array = NDArray[np.float64]

UP, DOWN, PUSH = "up", "down", "push"
BEHIND_M, CLEAR_M = 0.016, 0.012


@pytest.fixture(scope="module")
def env() -> Iterator[PsmPush]:
    made = PsmPush(speed=0.3, starts=2)
    yield made
    made.close()


class Pusher:
    """A policy that knows the way: down behind the block, push, and again where the block slips off."""

    def __init__(self, env: PsmPush) -> None:
        self._env, self._does = env, UP
        self._low = env.goal[2] - BLOCK.half_m[2] + 0.003

    def ends(self) -> Array:
        """Between the ends of the fingers (3,)."""
        fingers = self._env._parts_now()[1:]
        return np.asarray(np.mean([part.middle + part.axes[:, 2] * sum(part.size[:2]) for part in fingers], axis=0))

    def action(self) -> Array:
        block, ends, goal = self._env.truly_achieved(), self.ends(), self._env.goal
        far = float(np.linalg.norm((goal - block)[:2]))
        way, beside = (goal - block)[:2] / max(far, 1e-9), ends[:2] - block[:2]
        above = np.append(block[:2] - BEHIND_M * way, self._low + CLEAR_M)
        if far < 0.002:
            return self._toward(np.append(ends[:2], self._low + CLEAR_M), ends, 1.0)
        if self._does == PUSH and (beside @ way > 0.0 or abs(beside[0] * way[1] - beside[1] * way[0]) > 0.003):
            self._does = UP
        if self._does == UP and np.linalg.norm(ends - above) < 0.002:
            self._does = DOWN
        if self._does == DOWN and np.linalg.norm(ends - (*above[:2], self._low)) < 0.002:
            self._does = PUSH
        if self._does == UP:
            is_above = ends[2] > self._low + 0.009 or np.linalg.norm((ends - above)[:2]) < 0.003
            return self._toward(above if is_above else np.append(ends[:2], above[2]), ends, 1.0)
        if self._does == DOWN:
            return self._toward(np.append(above[:2], self._low), ends, 1.0)
        return self._toward(np.append(block[:2] - 0.004 * way, self._low), ends, 0.3)

    def _toward(self, target: Array, ends: Array, most: float) -> Array:
        action = np.zeros(7)
        action[:3] = np.clip((target - ends) / 0.0037, -most, most)
        return action


@pytest.mark.parametrize("seed", [0, 5])
@pytest.mark.slow
def test_a_policy_that_knows_the_way_pushes_the_block_to_its_goal(env: PsmPush, seed: int) -> None:
    env.reset(seed=seed)
    pusher = Pusher(env)
    for _ in range(300):
        _, _, terminated, _, info = env.step(pusher.action())
        assert not terminated, info
        if info["distance_m"] < 0.002:
            break
    assert info["is_success"], info


def test_a_block_that_nobody_touches_lies_where_it_was_put(env: PsmPush) -> None:
    env.reset(seed=4)
    before = env.objects.pose(0)
    for _ in range(40):
        env.step(np.zeros(7))
    assert np.abs(env.objects.pose(0) - before).max() < 1e-5
    assert abs(before[2, 3] - env.goal[2]) < 1e-4, "it is not in the table"


@pytest.mark.slow
def test_episodes_are_the_same_whatever_was_pushed_before(env: PsmPush) -> None:
    other = PsmPush(speed=0.3, starts=2)
    first = drawn(env, 5, 25)
    drawn(env, 6, 25)
    assert drawn(env, 5, 25) == first == drawn(other, 5, 25)
    other.close()


@pytest.mark.slow
def test_jaws_that_come_down_on_a_block_do_not_press_it_through_the_table(env: PsmPush) -> None:
    env.reset(seed=1)
    pusher = Pusher(env)
    for height_m in (0.012, -0.002):
        for _ in range(30):
            block, ends = env.truly_achieved(), pusher.ends()
            env.step(pusher._toward(np.append(block[:2], env.goal[2] + height_m), ends, 1.0))
            assert block[2] > env.goal[2] - 0.002 and np.isfinite(block).all()


def test_the_block_turns_about_where_it_is_pushed_beside_its_middle(env: PsmPush) -> None:
    env.reset(seed=2)
    x, y, z = env.truly_achieved()
    objects, turned = env.objects, []
    for beside_m in (-0.004, 0.004):
        objects.place(np.array([[x, y, 0.0]]), [_finger(x - 0.02, y + beside_m, z)] * 3)
        objects.follow([_finger(x + 0.005, y + beside_m, z)] * 3, 0.5)
        pose = objects.pose(0)
        assert pose[0, 3] > x + 0.005
        turned.append(float(np.arctan2(pose[1, 0], pose[0, 0])))
    assert turned[0] > 0.1 and turned[1] < -0.1


def _finger(x: float, y: float, z: float) -> Drawn:
    return rod(np.array((x, y, z)), np.array((x, y, z + 0.0105)), 0.0016, DARK)
