"""A policy of RLlib that learns to reach with a PSM, and the same policy for `trocar rl rollout`, here or on a robot.

    python -m trocar.tools.examples.rllib_reach ./reach
    TROCAR_POLICY=./reach trocar rl rollout trocar/PsmReach-v0 -n 100 --policy
    trocar.tools.examples.rllib_reach:LearnedPolicy

It needs `pip install 'trocar[rl]' 'ray[rllib]' torch`; docs/simulation.md has what came out.
"""

from __future__ import annotations

import argparse
import importlib.util
import os
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import gymnasium

Array = NDArray[np.float32]

ENVIRONMENT: Final = "trocar:trocar/PsmReach-v0"
GOOD: Final = 0.95
"""So many of the episodes have to end at the goal before learning stops."""
SCALE_M: Final = 0.03
"""A distance that the network sees as 1."""
REWARD: Final = 10.0
"""A reward of −1 m is as much."""
HORIZON: Final = 60
RUNNERS: Final = 3
"""With the learner, four cores."""
ACTIONS: Final = 7
"""Of the environment: shift and turn of the tip, jaw."""
NEEDED, INSTALL = ("gymnasium", "ray", "torch"), "pip install 'trocar[rl]' 'ray[rllib]' torch"
POLICY: Final = "TROCAR_POLICY"
"""In the environment: the folder of a policy that was learned."""


def features(observation: dict[str, Any]) -> Array:
    """What the network sees (3,): from the tip to the goal."""
    away = np.asarray(observation["desired_goal"]) - np.asarray(observation["achieved_goal"])
    return np.asarray(np.clip(away / SCALE_M, -5.0, 5.0), np.float32)


def action_of(shift: Any) -> Array:
    """An action (ACTIONS,) whose first three numbers, the tip's shift, the network gives; the rest stands still."""
    action = np.zeros(ACTIONS, np.float32)
    action[:3] = np.clip(shift, -1.0, 1.0)
    return action


def made(options: dict[str, Any]) -> gymnasium.Env[Any, Any]:
    """The environment as the network sees it; `options` as RLlib hands them on."""
    import gymnasium
    from gymnasium import spaces
    from gymnasium.wrappers import TransformAction, TransformObservation, TransformReward

    environment: Any = gymnasium.make(ENVIRONMENT, horizon=HORIZON, **options)
    environment = TransformObservation(environment, features, spaces.Box(-5.0, 5.0, (3,), np.float32))
    environment = TransformAction(environment, action_of, spaces.Box(-1.0, 1.0, (3,), np.float32))
    return TransformReward(environment, lambda reward: REWARD * float(reward))


class LearnedPolicy:
    """For `trocar rl rollout --policy`: what was learned into the folder that TROCAR_POLICY names."""

    def __init__(self) -> None:
        import torch
        from ray.rllib.core.rl_module import RLModule

        torch.set_num_threads(1)
        self._tensor = torch.from_numpy
        self._module = RLModule.from_checkpoint(str(Path(os.environ[POLICY]).resolve() / "module"))

    def __call__(self, observation: dict[str, Any]) -> Array:
        """The most likely action."""
        given = {"obs": self._tensor(features(observation)[None])}
        means = self._module.forward_inference(given)["action_dist_inputs"][0, :3]
        return action_of(means.detach().numpy())


def learn(folder: Path, iterations: int, runners: int) -> float:
    """Learn until it is GOOD, and keep the policy in `folder`; the share of the last episodes that reached the goal."""
    import ray
    from ray.rllib.algorithms.ppo import PPOConfig
    from ray.rllib.core.rl_module.default_model_config import DefaultModelConfig
    from ray.tune.registry import register_env

    register_env("reach", made)
    config = (PPOConfig().environment("reach")
              .env_runners(num_env_runners=runners, rollout_fragment_length="auto")
              .training(train_batch_size_per_learner=3000, minibatch_size=256, num_epochs=10, lr=1e-3, gamma=0.9,
                        lambda_=0.95, vf_clip_param=1e6, grad_clip=0.5)
              .rl_module(model_config=DefaultModelConfig(fcnet_hiddens=[64, 64], free_log_std=True))
              .callbacks(on_episode_end=_note_success)
              .debugging(seed=1))
    begin, share = time.perf_counter(), 0.0
    ray.init(num_cpus=runners + 1, include_dashboard=False, log_to_driver=False)
    try:
        algorithm = config.build_algo()
        for iteration in range(1, iterations + 1):
            result = algorithm.train()["env_runners"]
            share = float(result.get("success", 0.0))
            steps = int(result["num_env_steps_sampled_lifetime"])
            print(f"{iteration:3d}  {time.perf_counter() - begin:5.0f} s  {steps} steps  return "
                  f"{result['episode_return_mean']:.2f}  {100 * share:.0f} % reach the goal", flush=True)
            if share >= GOOD:
                break
        algorithm.get_module().save_to_path(str(folder.resolve() / "module"))
        algorithm.stop()
    finally:
        ray.shutdown()
    return share


def _note_success(*, episode: Any, metrics_logger: Any, **_: Any) -> None:
    metrics_logger.log_value("success", float(episode.get_infos(-1)["is_success"]), window=100)


def main() -> int:
    """Exit code 1: it has not learned it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path, help="of the policy")
    parser.add_argument("--iterations", type=int, default=60, help="at most")
    parser.add_argument("--runners", type=int, default=RUNNERS, help="processes with environments")
    given = parser.parse_args()
    if missing := [name for name in NEEDED if importlib.util.find_spec(name) is None]:
        print(f"{', '.join(missing)} not installed: {INSTALL}", file=sys.stderr)
        return 1
    given.folder.mkdir(parents=True, exist_ok=True)
    return 0 if learn(given.folder, given.iterations, given.runners) >= GOOD else 1


if __name__ == "__main__":
    sys.exit(main())
