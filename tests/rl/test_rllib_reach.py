"""The example for RLlib, as far as Gymnasium alone goes: what its network sees, and what it moves."""

from __future__ import annotations

import numpy as np
import pytest

from trocar.procs.rl.tasks import PsmReach
from trocar.tools.examples.rllib_reach import HORIZON, REWARD, SCALE_M, action_of, features, made


def test_its_network_sees_the_way_to_the_goal() -> None:
    seen = features({"desired_goal": (SCALE_M, 0.0, -9.0), "achieved_goal": (0.0, SCALE_M, 0.0)})
    assert seen.dtype == np.float32
    np.testing.assert_allclose(seen, (1.0, -1.0, -5.0))


def test_its_network_shifts_the_tip_and_nothing_else() -> None:
    action = action_of((0.5, -3.0, 0.0))
    assert action.dtype == np.float32
    np.testing.assert_array_equal(action, (0.5, -1.0, 0.0, 0.0, 0.0, 0.0, 0.0))


@pytest.mark.slow
def test_who_goes_where_its_features_point_reaches_the_goal() -> None:
    env = made({"starts": 1})
    assert isinstance(env.unwrapped, PsmReach) and env.unwrapped.horizon == HORIZON
    seen, _ = env.reset(seed=3)
    for _ in range(HORIZON):
        assert seen in env.observation_space
        seen, reward, _, _, info = env.step(np.clip(seen * 10.0, -1.0, 1.0))
    assert info["is_success"] and reward == pytest.approx(-REWARD * info["distance_m"])
    env.close()
