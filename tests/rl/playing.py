"""Environments under test, and what a policy that knows the way does in them."""

from __future__ import annotations

from typing import Any

import numpy as np

from trocar.procs.rl.environment import RobotEnv
from trocar.procs.rl.hosted import document
from trocar.procs.rl.model import ArmModel


def psm(backend: str = "kinematic") -> ArmModel:
    """A PSM as an environment knows it."""
    arm = document("kinematic.yaml", backend, 0.002, 0.002).arm("PSM1")
    assert arm.tool is not None
    return ArmModel(arm, arm.tool.name, np.eye(4))


def toward(observation: dict[str, Any], size: int) -> Any:
    """The action that goes straight to a goal, in Cartesian control."""
    action = np.zeros(size, dtype=np.float32)
    action[:3] = np.clip((observation["desired_goal"][:3] - observation["achieved_goal"][:3]) / 0.002, -1.0, 1.0)
    return action


def drawn(env: RobotEnv, seed: int, steps: int, start: int = 1) -> bytes:
    """All that is observed, and rewarded, of random actions, bit by bit."""
    random = np.random.default_rng(seed)
    observation, info = env.reset(seed=seed, options={"start": start})
    rows = [*observation.values()]
    for _ in range(steps):
        observation, reward, terminated, truncated, info = env.step(random.uniform(-1.0, 1.0, env.action_space.shape))
        rows += [*observation.values(), np.array((reward, terminated, truncated, info["distance_m"]))]
        assert not info["fault"] and not info["refused"], info
    return b"".join(row.tobytes() for row in rows)
