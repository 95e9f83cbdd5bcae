"""Episodes of a policy in an environment, one after the other, and their results."""

from __future__ import annotations

import contextlib
import hashlib
import importlib
import importlib.util
import inspect
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import gymnasium
import numpy as np
from gymnasium.envs.registration import load_env_creator
from numpy.typing import NDArray

import trocar.procs.rl.registration  # noqa: F401  # the names of our own
from trocar.procs.crtk.names import none_such
from trocar.procs.rl.backend import WrongAction
from trocar.procs.rl.environment import RobotEnv

Policy = Callable[[Any], Any]
"""From an observation to an action."""

RANDOM: Final = "random"
"""The policy that draws its actions, seeded as the episode is."""


class NoPolicy(ValueError):
    """A policy that cannot be had, and why."""


class PolicyFailed(RuntimeError):
    """A policy that raised an error when called for an action: which, and where."""


@dataclass(frozen=True, slots=True)
class RolloutTask:
    """The run: an environment with its options, and a policy as `policy_of` takes it."""

    environment: str
    options: Mapping[str, Any]
    policy: str = RANDOM
    keeps: bool = False
    """Also keep observations and actions."""


@dataclass(frozen=True, slots=True)
class Episode:
    """Result of one episode. Its hash covers every observation and reward, bit by bit."""

    seed: int
    steps: int
    reward: float
    is_success: bool
    is_terminated: bool
    state: str
    fault: str
    hash: str
    cpu_s: float
    wall_s: float
    simulated_s: float
    kept: Mapping[str, NDArray[Any]] | None = None
    """Observations by part (steps + 1, size), actions (steps, size), rewards (steps,)."""


def check(task: RolloutTask) -> None:
    """NoPolicy, or gymnasium's error for an unknown environment: errors known without making it."""
    policy_of(task.policy)
    with _near(task.environment):
        gymnasium.spec(task.environment)


@contextlib.contextmanager
def _near(environment: str) -> Iterator[None]:
    """Gymnasium's error for an unknown environment, with those of ours that have similar names."""
    try:
        yield
    except gymnasium.error.UnregisteredEnv:
        known = [name for name in gymnasium.registry if name.startswith("trocar/")]
        raise gymnasium.error.UnregisteredEnv(none_such("environment", environment, known)) from None


class EpisodeRunner:
    """An environment and a policy that are made once, for any number of episodes."""

    def __init__(self, task: RolloutTask) -> None:
        """NoPolicy; gymnasium.make's errors for unknown environments, and their own for wrong options."""
        self._policy, self._named = policy_of(task.policy), task.policy
        self._keeps = task.keeps
        self._environment: gymnasium.Env[Any, Any]
        try:
            with _near(task.environment):
                _check_render_mode(task)
                self._environment = gymnasium.make(task.environment, **task.options)
        except TypeError as error:  # of the class's own, with gymnasium's words about it
            raise error.__cause__ or error from None
        self._step_s = 1.0 / float(self._environment.metadata["render_fps"])

    def run(self, seed: int) -> Episode:
        """One episode from its reset to its end; PolicyFailed."""
        environment, policy = self._environment, self._policy
        cpu, wall = time.process_time_ns(), time.perf_counter_ns()
        digest, rewards, seen, done = hashlib.sha256(), [], [], []
        observation, info = environment.reset(seed=seed)
        environment.action_space.seed(seed)
        ends = truncated = False
        _take(observation, digest)
        seen.append(observation)
        while not (ends or truncated):
            action = environment.action_space.sample() if policy is None else self._asked(policy, observation)
            try:
                observation, reward, ends, truncated, info = environment.step(action)
            except WrongAction as error:
                raise PolicyFailed(f"policy {self._named} failed: {error}") from error
            _take(observation, digest)
            digest.update(np.float64(reward).tobytes())
            rewards.append(float(reward))
            if self._keeps:
                seen.append(observation)
                done.append(np.array(action))
        return Episode(
            seed, len(rewards), sum(rewards), bool(info.get("is_success", False)), bool(ends),
            str(info.get("state", "")), str(info.get("fault", "")), digest.hexdigest()[:16],
            (time.process_time_ns() - cpu) * 1e-9, (time.perf_counter_ns() - wall) * 1e-9, len(rewards) * self._step_s,
            _kept(seen, done, rewards) if self._keeps else None)

    def _asked(self, policy: Policy, observation: Any) -> Any:
        """The policy's action; PolicyFailed."""
        try:
            return policy(observation)
        except (Exception, SystemExit) as error:
            _, *places = traceback.extract_tb(error.__traceback__)
            where = f", {places[-1].filename}:{places[-1].lineno}" if places else ""
            raise PolicyFailed(f"policy {self._named} failed: {type(error).__name__}: {error}{where}") from error

    def check(self) -> None:
        """RobotStopped if a person must check the robot after the last episode, as the next reset would raise it."""
        if isinstance(robot := self._environment.unwrapped, RobotEnv):
            robot.robot.check()

    def close(self) -> None:
        """The environment ends."""
        self._environment.close()


def run(task: RolloutTask, seeds: Iterable[int]) -> Iterator[Episode]:
    """All episodes in this process, each as soon as it has ended; RobotStopped after the last one as well."""
    runner = EpisodeRunner(task)
    try:
        for seed in seeds:
            yield runner.run(seed)
        runner.check()
    finally:
        runner.close()


def _take(observation: Any, digest: Any) -> None:
    if isinstance(observation, Mapping):
        for key in sorted(observation):
            _take(observation[key], digest)
    else:
        digest.update(np.ascontiguousarray(observation).tobytes())


def _kept(seen: list[Any], done: list[Any], rewards: list[float]) -> dict[str, NDArray[Any]]:
    parts = sorted(seen[0]) if isinstance(seen[0], Mapping) else []
    rows = {part: np.array([each[part] for each in seen]) for part in parts} or {"observation": np.array(seen)}
    return {**rows, "action": np.array(done), "reward": np.array(rewards)}


def _check_render_mode(task: RolloutTask) -> None:
    """ValueError for one that the environment does not draw; gymnasium.make puts a window around it instead."""
    spec, mode = gymnasium.registry.get(task.environment.rpartition(":")[2]), task.options.get("render_mode")
    entry = spec.entry_point if spec is not None else None
    made = load_env_creator(entry) if isinstance(entry, str) else entry
    modes = [None, *getattr(made, "metadata", {}).get("render_modes", [mode])]
    if mode not in modes:
        raise ValueError(f"render_mode is {mode!r}; allowed: {', '.join(map(repr, modes))}")


def policy_of(text: str) -> Policy | None:
    """A policy by its text: `random` (None), or FILE.py:NAME or MODULE:NAME of a function that takes an observation.

    A class is called first, without arguments: its object is the policy, loaded once. NoPolicy describes the error.
    """
    if text == RANDOM:
        return None
    where, colon, name = text.rpartition(":")
    if not colon or not where or not name.isidentifier():
        raise NoPolicy(f"policy {text!r}: allowed are {RANDOM}, FILE.py:NAME and MODULE:NAME")
    found = getattr(_module(where), name, None)
    if found is None:
        raise NoPolicy(f"policy {text!r}: there is no {name} in {where}")
    try:
        policy = found() if inspect.isclass(found) else found
    except (Exception, SystemExit) as error:
        raise NoPolicy(f"policy {text!r}: {name}() failed: {type(error).__name__}: {error}") from error
    if not callable(policy):
        raise NoPolicy(f"policy {text!r}: {name} cannot be called with an observation")
    return policy  # type: ignore[no-any-return]


def _module(where: str) -> Any:
    try:
        if not where.endswith(".py"):
            return importlib.import_module(where)
        path = Path(where).resolve(strict=True)
        spec = importlib.util.spec_from_file_location(path.stem, path)
        assert spec is not None and spec.loader is not None, "a name that ends in .py has one"
        module = importlib.util.module_from_spec(spec)
        sys.modules.setdefault(path.stem, module)
        spec.loader.exec_module(module)
    except (OSError, ImportError, SyntaxError, SystemExit) as error:
        raise NoPolicy(f"policy from {where}: {type(error).__name__}: {error}") from None
    return module
