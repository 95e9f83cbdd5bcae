"""Episodes of a policy: told by their seed, wherever they run; what cannot be run is said before anything begins."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar

import gymnasium
import numpy as np
import pytest
from typer.testing import CliRunner

from trocar.procs.rl import ray_actors
from trocar.procs.rl.backend import RobotStopped
from trocar.procs.rl.rollouts import EpisodeRunner, NoPolicy, PolicyFailed, RolloutTask, check, policy_of, run
from trocar.procs.rl.tasks import PsmReach
from trocar.tools import cli

ROOT = Path(__file__).resolve().parents[2]
CART = RolloutTask("CartPole-v1", {})
"""An environment of Gymnasium's own: what is said here does not hang on ours."""
POLICIES = """
def leans(observation):
    return int(observation[2] > 0)

class Balances:
    made = 0
    def __init__(self):
        Balances.made += 1
    def __call__(self, observation):
        return int(observation[2] + 0.3 * observation[3] > 0)

number = 3
"""


@pytest.fixture
def policies(tmp_path: Path) -> Path:
    file = tmp_path / "policies.py"
    file.write_text(POLICIES)
    return file


@pytest.mark.slow
def test_a_policy_whose_action_is_none_is_named(tmp_path: Path) -> None:
    file = tmp_path / "talks.py"
    file.write_text("def talks(observation):\n    return 'hello'\n")
    with pytest.raises(PolicyFailed, match=r"policy .*talks\.py:talks failed: an action is 7 finite numbers"):
        list(run(RolloutTask("trocar/PsmReach-v0", {}, f"{file}:talks"), [1]))


def test_only_our_own_environments_are_suggested() -> None:
    with pytest.raises(gymnasium.error.UnregisteredEnv, match=r"did you mean trocar/PsmReach-v0\?$"):
        check(RolloutTask("PsmReach", {}))
    with pytest.raises(gymnasium.error.UnregisteredEnv, match="there are: trocar/") as found:
        check(RolloutTask("CartPol-v1", {}))
    assert "CartPole" not in str(found.value)


def test_a_seed_says_all_of_an_episode() -> None:
    first, again = list(run(CART, [3, 4, 5])), list(run(CART, [5, 3]))
    hashes = {row.seed: row.hash for row in first}
    assert len(set(hashes.values())) == 3
    assert {row.seed: row.hash for row in again} == {5: hashes[5], 3: hashes[3]}
    assert all(row.steps == row.reward and row.is_terminated for row in first)
    assert all(row.simulated_s == pytest.approx(row.steps / 50) for row in first)


def test_a_policy_from_a_file_acts(policies: Path) -> None:
    (leaning,) = run(RolloutTask("CartPole-v1", {}, f"{policies}:leans"), [1])
    (balanced,) = run(RolloutTask("CartPole-v1", {}, f"{policies}:Balances"), [1])
    assert leaning.steps < 100 and balanced.steps == 500 and not balanced.is_terminated


def test_what_was_seen_and_done_can_be_kept(policies: Path) -> None:
    (episode,) = run(RolloutTask("CartPole-v1", {}, f"{policies}:leans", keeps=True), [1])
    assert episode.kept is not None
    seen, done = episode.kept["observation"], episode.kept["action"]
    assert seen.shape == (episode.steps + 1, 4) and done.shape == episode.kept["reward"].shape == (episode.steps,)
    assert (done == (seen[:-1, 2] > 0)).all()


@pytest.mark.parametrize(("text", "wrong"), [
    ("best", "allowed are random, FILE.py:NAME"), ("nowhere.py:best", "No such file"), ("{file}:best", "no best in"),
    ("{file}:number", "cannot be called"), ("no.such.module:best", "No module named"), ("{file}:a b", "allowed are")])
def test_a_policy_that_cannot_be_had_is_told(text: str, wrong: str, policies: Path) -> None:
    with pytest.raises(NoPolicy, match=wrong):
        policy_of(text.format(file=policies))


def test_a_file_with_a_mistake_is_told(tmp_path: Path) -> None:
    (tmp_path / "wrong.py").write_text("def best(:\n")
    with pytest.raises(NoPolicy, match="invalid syntax"):
        check(RolloutTask("CartPole-v1", {}, f"{tmp_path / 'wrong.py'}:best"))


def test_a_policy_that_fails_says_where(tmp_path: Path) -> None:
    file = tmp_path / "failing.py"
    file.write_text("def acts(observation):\n    return observation['none']\n"
                    "class Learned:\n    def __init__(self):\n        self.weights = 1 / 0.0\n"
                    "def leaves(observation): raise SystemExit(3)\n")
    with pytest.raises(PolicyFailed, match=r"acts failed: IndexError: .*failing.py:2"):
        list(run(RolloutTask("CartPole-v1", {}, f"{file}:acts"), [1]))
    with pytest.raises(PolicyFailed, match=r"leaves failed: SystemExit: 3.*failing.py:6"):
        list(run(RolloutTask("CartPole-v1", {}, f"{file}:leaves"), [1]))
    with pytest.raises(NoPolicy, match=r"Learned\(\) failed: ZeroDivisionError"):
        policy_of(f"{file}:Learned")


def rollout(*words: str) -> tuple[int, list[dict[str, Any]]]:
    """Exit code and what the verb printed."""
    done = CliRunner().invoke(cli.build("rl"), ["rl", "rollout", *words, "--json"])
    return done.exit_code, [json.loads(line) for line in done.stdout.splitlines()]


def test_the_verb_prints_and_keeps_episodes(tmp_path: Path, policies: Path) -> None:
    code, rows = rollout("CartPole-v1", "-n", "3", "--seed", "7", "--policy", f"{policies}:leans",
                         "--save", str(tmp_path / "kept"))
    assert code == 0 and [row["seed"] for row in rows[:-1]] == [7, 8, 9]
    assert rows[-1]["summary"]["steps"] == sum(row["steps"] for row in rows[:-1])
    with np.load(tmp_path / "kept" / "episode-8.npz") as kept:
        assert len(kept["action"]) == rows[1]["steps"]


ENDLESS = """
import gymnasium

class Endless(gymnasium.Env):
    metadata = {"render_modes": [], "render_fps": 10}
    observation_space = action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        print("begun", flush=True)
        return 0, {}

    def step(self, action):
        return 0, 0.0, False, False, {}

    def close(self):
        print("closed", flush=True)

gymnasium.register("Endless-v0", entry_point=Endless)
"""


@pytest.mark.slow
@pytest.mark.parametrize("sent", [signal.SIGTERM, signal.SIGINT])
def test_who_ends_it_from_outside_has_its_environment_closed(tmp_path: Path, sent: int) -> None:
    (tmp_path / "endless.py").write_text(ENDLESS)
    with subprocess.Popen([sys.executable, "-m", "trocar", "rl", "rollout", "endless:Endless-v0"], cwd=ROOT, text=True,
                          stderr=subprocess.PIPE, env={**os.environ, "PYTHONPATH": f"{ROOT}:{tmp_path}"}) as process:
        assert process.stderr is not None
        for line in process.stderr:
            if "begun" in line:
                break
        process.send_signal(sent)
        left = process.stderr.read()
        assert process.wait(60.0) == 130
    assert "closed" in left and "trocar: stopped by Ctrl-C" in left and "Traceback" not in left


class Trips(gymnasium.Env[int, int]):
    """A robot that faults in the first step."""

    metadata: ClassVar[dict[str, Any]] = {"render_modes": [], "render_fps": 10}
    observation_space = action_space = gymnasium.spaces.Discrete(2)

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[int, dict[str, Any]]:
        super().reset(seed=seed)
        return 0, {}

    def step(self, action: int) -> tuple[int, float, bool, bool, dict[str, Any]]:
        return 0, 0.0, True, False, {"state": "FAULT", "fault": "PSM1 is FAULT: an amplifier is hot"}


def test_the_fault_that_ended_an_episode_is_told() -> None:
    gymnasium.register("Trips-v0", entry_point=Trips)
    try:
        code, rows = rollout("Trips-v0", "-n", "1")
        done = CliRunner().invoke(cli.build("rl"), ["rl", "rollout", "Trips-v0", "-n", "1"])
    finally:
        del gymnasium.registry["Trips-v0"]
    assert code == 0, done.output + str(done.exception)
    assert rows[0]["fault"] == "PSM1 is FAULT: an amplifier is hot" and rows[0]["is_terminated"]
    assert {"an", "amplifier", "is", "hot"} <= set(done.stdout.split()) and "itself" not in done.stdout


class StopsLater(Trips):
    """A robot that faults in its first episode, so that no other one begins."""

    episodes = 0

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[int, dict[str, Any]]:
        self.episodes += 1
        if self.episodes > 1:
            raise RobotStopped("PSM1 is FAULT: an amplifier is hot; first: trocar home PSM1")
        return super().reset(seed=seed, options=options)


def test_a_single_episode_is_called_one() -> None:
    done = CliRunner().invoke(cli.build("rl"), ["rl", "rollout", "CartPole-v1", "-n", "1"])
    assert "1 episodes" not in done.stdout and "1 episode" in done.stdout


def test_episodes_before_a_fault_are_printed_with_the_reason_of_the_early_end() -> None:
    gymnasium.register("Stops-v0", entry_point=StopsLater)
    try:
        code, rows = rollout("Stops-v0", "-n", "5")
        done = CliRunner().invoke(cli.build("rl"), ["rl", "rollout", "Stops-v0", "-n", "5"])
    finally:
        del gymnasium.registry["Stops-v0"]
    assert code == 1 and (rows[-1]["summary"]["episodes"], rows[-1]["summary"]["asked"]) == (1, 5)
    assert done.exit_code == 1 and "1 of 5" in done.stdout and "trocar home PSM1" in done.stderr


@pytest.mark.parametrize("check_it", [check, EpisodeRunner])
def test_an_environment_whose_name_is_incomplete_is_suggested(check_it: Callable[[RolloutTask], object]) -> None:
    with pytest.raises(gymnasium.error.Error, match="did you mean trocar/PsmReach-v0"):
        check_it(RolloutTask("PsmReach", {}))


@pytest.mark.parametrize(("words", "code"), [
    (("CartPol-v1",), 2), (("no.such.module:CartPole-v1",), 2), (("CartPole-v1", "--policy", "math:sin"), 1),
    (("CartPole-v1", "--policy", "best"), 2), (("CartPole-v1", "--option", "gravity"), 2),
    (("CartPole-v1", "--option", "gravity=3"), 2), (("CartPole-v1", "--address", "auto"), 2),
    (("CartPole-v1", "--save", "/proc/nowhere"), 1), (("CartPole-v1", "--save", "/"), 2),
    (("CartPole-v1", "--actors", "2", "--option", "backend=attached"), 2)])
def test_what_was_asked_wrongly_is_told(words: tuple[str, ...], code: int) -> None:
    assert rollout(*words) == (code, [])


def test_a_rollout_takes_the_system_that_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TROCAR_SYSTEM", "another")
    done = CliRunner().invoke(cli.build("rl"), ["rl", "rollout", "trocar/PsmReach-v0", "-o", "backend=attached",
                                                "--system", "nosuch"])
    assert done.exit_code == 1 and "no system nosuch is up" in done.stderr, done.output


@pytest.mark.parametrize("token", ["theirs", None])
def test_the_token_of_whoever_calls_us_is_theirs_again(monkeypatch: pytest.MonkeyPatch, token: str | None) -> None:
    monkeypatch.delenv(ray_actors.TOKEN, raising=False)
    if token is not None:
        monkeypatch.setenv(ray_actors.TOKEN, token)
    with contextlib.ExitStack() as held:
        folder = Path(ray_actors._of_our_own(held, 1)["_temp_dir"])
        assert folder.exists() and os.environ[ray_actors.TOKEN] not in ("", "theirs")
    assert os.environ.get(ray_actors.TOKEN) == token and not folder.exists()


def test_a_misspelt_option_is_told_with_those_that_there_are() -> None:
    for environment, options in (("trocar/PsmPush-v0", {"max_episode_steps": 5, "backnd": "attached"}),
                                 ("trocar/PsmReach-v0", {"backnd": "attached"})):
        with pytest.raises(TypeError, match=r"no option backnd; allowed: backend, control, .*height$"):
            EpisodeRunner(RolloutTask(environment, options))
    with pytest.raises(TypeError, match=r"PsmReach has no option bckend; allowed: backend, .*height$"):
        PsmReach(bckend="attached")  # type: ignore[call-arg]


def test_a_picture_that_an_environment_does_not_draw_is_a_wrong_value() -> None:
    with pytest.raises(ValueError, match="render_mode is 'human'; allowed: None, 'rgb_array'"):
        EpisodeRunner(RolloutTask("trocar/PsmReach-v0", {"render_mode": "human"}))
