"""`trocar rl rollout`: a policy in an environment, episode after episode, on as many cores as wanted."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import statistics
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from trocar.procs.machine.extras import missing_in
from trocar.tools.output.errors import Misuse, Problem
from trocar.tools.output.printing import emit, number, progress, table, tell
from trocar.tools.verbs.options import JsonOption, SystemOption

if TYPE_CHECKING:
    from trocar.procs.rl.rollouts import Episode, RolloutTask

COLUMNS = ("seed", "steps", "return", "success", "ended by", "state", "hash")


def rollout(
    environment: Annotated[str, typer.Argument(metavar="ENVIRONMENT", help="Its name, as for gymnasium.make.")],
    episodes: Annotated[int, typer.Option("--episodes", "-n", min=1, help="Number of episodes.")] = 10,
    actors: Annotated[int, typer.Option("--actors", min=0, help="Ray processes, one core each; 0: none.")] = 0,
    policy: Annotated[str, typer.Option(
        "--policy", metavar="POLICY", help="random, FILE.py:NAME or MODULE:NAME: called with each observation.")
    ] = "random",
    options: Annotated[list[str] | None, typer.Option(
        "--option", "-o", metavar="KEY=VALUE", help="An option of the environment; JSON, or text.")] = None,
    seed: Annotated[int, typer.Option("--seed", min=0, help="Seed of the first episode; then counted up.")] = 0,
    address: Annotated[str, typer.Option("--address", help="Address of a running cluster; auto: the local one.")] = "",
    save: Annotated[Path | None, typer.Option(
        "--save", metavar="FOLDER", help="New folder for observations and actions: a numpy file per episode.")] = None,
    as_json: JsonOption = False,
    system: SystemOption = None,
) -> int:
    """Run episodes and print the results. Each has a hash of its observations and rewards: the same seed gives the same
    hash on every machine.

    Each actor has an environment of its own and runs whole episodes. A cluster needs `ray start` on each machine, and
    Trocar with the policy's file at the same place. With `--option backend=attached` it moves the arms of a running
    system (`--system`), which a person has homed, and hashes differ: docs/simulation.md.

    Example: trocar rl rollout trocar/PsmReach-v0 --episodes 1
    """
    task, seeds = _task(environment, policy, options or (), save is not None), range(seed, seed + episodes)
    if address and not actors:
        raise Misuse("--address needs --actors")
    if task.options.get("backend") == "attached":
        task = _attached(task, actors, system)
    if save is not None:
        _make(save)
    from time import perf_counter

    from trocar.procs.machine.end_signals import ended_as_by_ctrl_c

    begin, done, output = perf_counter(), [], sys.stdout
    try:
        # an arm that is attached holds in the end; Ray prints, too
        with (ended_as_by_ctrl_c(), _problems(), contextlib.redirect_stdout(sys.stderr),
              progress(task.environment) as say):
            for episode in _run(task, seeds, actors, address):
                done.append(episode)
                say(f"{len(done)} of {episodes} episodes", len(done) / episodes)
                if save is not None:
                    _save(save, episode)
                if as_json:
                    with contextlib.redirect_stdout(output):
                        emit(_row(episode))
    finally:  # also of those before a fault or Ctrl-C
        if done:
            summary = _summary(task, done, perf_counter() - begin, actors) | {"asked": episodes}
            emit({"summary": summary}) if as_json else _show(done, summary)
    return 0


def _task(environment: str, policy: str, options: Sequence[str], keeps: bool) -> RolloutTask:
    with _problems():
        from trocar.procs.rl.rollouts import RolloutTask

    values: dict[str, Any] = {}
    for text in options:
        key, given, value = text.partition("=")
        if not given or not key.isidentifier():
            raise Misuse(f"--option {text}: expected KEY=VALUE")
        try:
            values[key] = json.loads(value)
        except ValueError:
            values[key] = value
    return RolloutTask(environment, values, policy, keeps)


def _attached(task: RolloutTask, actors: int, system: str | None) -> RolloutTask:
    """The task with the arms of a running system."""
    if actors:
        raise Misuse("--actors: a running system has one robot; leave them out with backend=attached")
    from trocar.procs.rl.attached import RunningSystem

    return dataclasses.replace(task, options={**task.options, "backend": RunningSystem(system or "")})


def _make(folder: Path) -> None:
    with _written(folder):
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            raise Misuse(f"{folder} is there already; --save names a new folder") from None


def _run(task: RolloutTask, seeds: Sequence[int], actors: int, address: str) -> Iterator[Episode]:
    from trocar.procs.rl import ray_actors, rollouts

    return ray_actors.run(task, seeds, actors, address) if actors else rollouts.run(task, seeds)


@contextlib.contextmanager
def _problems() -> Iterator[None]:
    """What may go wrong in there, as a person should hear it."""
    try:
        yield
    except ModuleNotFoundError as error:
        if error.name is None:  # in Gymnasium's words: MODULE:NAME of an environment
            raise Misuse(str(error)) from error
        if sentence := missing_in(error):
            raise Problem(sentence) from None
        raise
    except Exception as error:
        from gymnasium.error import Error

        from trocar.procs.rl.backend import RobotStopped
        from trocar.procs.rl.ray_actors import RolloutError
        from trocar.procs.rl.rollouts import NoPolicy, PolicyFailed

        if isinstance(error, NoPolicy | Error | TypeError | ValueError):
            raise Misuse(str(error)) from error
        if isinstance(error, PolicyFailed | RolloutError | RobotStopped):
            raise Problem(str(error)) from error
        raise


@contextlib.contextmanager
def _written(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise Problem(f"{error.filename or folder}: {error.strerror}") from None


def _save(folder: Path, episode: Episode) -> None:
    import numpy as np

    assert episode.kept is not None
    with _written(folder):
        np.savez_compressed(folder / f"episode-{episode.seed}.npz", allow_pickle=False, **episode.kept)


def _row(episode: Episode) -> dict[str, Any]:
    fields = [field.name for field in dataclasses.fields(episode) if field.name != "kept"]
    return {name: getattr(episode, name) for name in fields}


def _summary(task: RolloutTask, done: Sequence[Episode], wall_s: float, actors: int) -> dict[str, Any]:
    steps, cpu = sum(row.steps for row in done), sum(row.cpu_s for row in done)
    simulated = sum(row.simulated_s for row in done)
    return {"environment": task.environment, "policy": task.policy, "episodes": len(done), "actors": actors,
            "success": sum(row.is_success for row in done) / len(done),
            "return_median": statistics.median(row.reward for row in done), "steps": steps, "wall_s": wall_s,
            "steps_per_s": steps / wall_s, "simulated_per_cpu_s": simulated / max(cpu, 1e-9)}


def _show(done: Sequence[Episode], summary: dict[str, Any]) -> None:
    rows = sorted(done, key=lambda row: row.seed)
    table("", COLUMNS, (
        (str(row.seed), str(row.steps), number(row.reward, ".3f"), "yes" if row.is_success else "no",
         row.fault or ("itself" if row.is_terminated else "time"), row.state, row.hash)
        for row in rows), ("seed", "steps", "return"))
    count, asked = summary["episodes"], summary["asked"]
    what = f"ended early: {count} of {asked}" if count < asked else str(count)
    tell(f"{what} episode{'s' if asked != 1 else ''}, {100 * summary['success']:.0f} % with success; "
         f"{summary['steps_per_s']:.0f} steps/s, {summary['simulated_per_cpu_s']:.1f} s simulated a CPU second")
