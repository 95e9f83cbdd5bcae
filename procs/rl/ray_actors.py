"""Episodes on Ray: each actor has its own environment and runs whole episodes, not steps, per call."""

from __future__ import annotations

import contextlib
import logging
import os
import secrets
import shutil
import socket
import tempfile
import time
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

from trocar.procs.machine.end_signals import ended_as_by_ctrl_c
from trocar.procs.machine.extras import missing
from trocar.procs.rl.rollouts import Episode, EpisodeRunner, RolloutTask, check

QUIET: Final = {"RAY_USAGE_STATS_ENABLED": "0", "RAY_DEDUP_LOGS": "0", "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0"}
ONE_THREAD: Final = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
TOKEN: Final = "RAY_AUTH_TOKEN"
"""Without it in the environment, Ray keeps one for all its clusters in the home folder."""
LOOPBACK: Final = "127.0.0.2"
"""Ray takes 127.0.0.1 for a mistake, and uses the machine's address instead."""
STORE_BYTES: Final = 200_000_000
"""Size of Ray's object store if we start Ray: results are small."""
ROUNDS: Final = 4
"""Number of shares of the episodes that an actor gets, one after the other."""
LARGEST: Final = 16
"""Episodes of a share at most."""
CONNECT_S: Final = 5.0
"""A cluster that takes longer to answer counts as absent; Ray itself would retry for minutes."""
CLEAR_S: Final = 5.0


class RolloutError(RuntimeError):
    """Rollouts that cannot continue, with the reason."""


@contextlib.contextmanager
def running_ray(actors: int, address: str = "") -> Iterator[Any]:
    """Ray's module, with room for this many actors: from a cluster at `address`, or one of our own.

    Our own keeps its files in a temporary folder, which is removed. RolloutError: no Ray, or no cluster.
    """
    os.environ.update({key: value for key, value in QUIET.items() if key not in os.environ})
    if lacks := missing("ray"):
        raise RolloutError(lacks)
    import ray

    with _told():
        _answers(address)
    with contextlib.ExitStack() as held:
        own = {} if address else _of_our_own(held, actors)
        held.callback(ray.shutdown)
        with _told():
            ray.init(address=address or "local", log_to_driver=False, logging_level=logging.ERROR,
                     runtime_env={"env_vars": ONE_THREAD}, **own)
        held.enter_context(ended_as_by_ctrl_c())  # Ray's own handler aborts without cleanup
        yield ray


def _of_our_own(held: contextlib.ExitStack, actors: int) -> dict[str, Any]:
    """How we start it: on an address of this machine, with a token and a folder that end with it."""
    folder = tempfile.mkdtemp(prefix="trocar-ray-")
    held.callback(_remove, folder)
    before, os.environ[TOKEN] = os.environ.get(TOKEN), secrets.token_hex(32)
    held.callback(_put_back, before)
    return {"num_cpus": actors, "include_dashboard": False, "_temp_dir": folder, "object_store_memory": STORE_BYTES,
            "_node_ip_address": LOOPBACK}


def _put_back(token: str | None) -> None:
    """Restore the caller's token, for a cluster of theirs."""
    os.environ.pop(TOKEN, None)
    if token is not None:
        os.environ[TOKEN] = token


def _remove(folder: str) -> None:
    """Processes of Ray may still write into it while they end."""
    end_s = time.monotonic() + CLEAR_S
    while Path(folder).exists() and time.monotonic() < end_s:
        shutil.rmtree(folder, ignore_errors=True)
        time.sleep(0.05)


@contextlib.contextmanager
def _told() -> Iterator[None]:
    try:
        yield
    except (OSError, RuntimeError, ValueError) as error:
        raise RolloutError(f"Ray does not start: {str(error).strip().splitlines()[0]}") from error


def _answers(address: str) -> None:
    host, colon, port = address.rpartition(":")
    if colon and port.isdigit():
        socket.create_connection((host, int(port)), timeout=CONNECT_S).close()


class EpisodeActor:
    """In a process of Ray: an environment and its policy."""

    def __init__(self, task: RolloutTask) -> None:
        self._task = task
        self._runner: EpisodeRunner | None = None

    def episodes(self, seeds: Sequence[int]) -> list[Episode]:
        """This many episodes; one remote call for all of them. The first one raises errors of the task."""
        if self._runner is None:
            self._runner = EpisodeRunner(self._task)
        return [self._runner.run(seed) for seed in seeds]


def run(task: RolloutTask, seeds: Sequence[int], actors: int, address: str = "") -> Iterator[Episode]:
    """All episodes on this many actors of a CPU each, in order of completion. An actor that crashes is replaced once.

    NoPolicy and gymnasium's errors, before any start; RolloutError: no Ray, or an actor's failure.
    """
    check(task)
    with running_ray(actors, address) as ray:
        yield from shared(ray, actors_of(ray, task, min(actors, len(seeds))), seeds)


def actors_of(ray: Any, task: RolloutTask, count: int) -> list[Any]:
    """This many actors, a CPU each."""
    remote = ray.remote(num_cpus=1, max_restarts=1, max_task_retries=1)(EpisodeActor)
    return [remote.remote(task) for _ in range(count)]


def shared(ray: Any, runners: Sequence[Any], seeds: Sequence[int]) -> Iterator[Episode]:
    """Episodes, not fewer than `runners`, shared among these actors, as they end; RolloutError."""
    size = max(1, min(LARGEST, len(seeds) // (ROUNDS * len(runners))))
    shares = deque(seeds[at : at + size] for at in range(0, len(seeds), size))
    asked = {runner.episodes.remote(shares.popleft()): runner for runner in runners}
    while asked:
        (ready, *_), _ = ray.wait(list(asked))
        runner = asked.pop(ready)
        if shares:
            asked[runner.episodes.remote(shares.popleft())] = runner
        try:
            episodes = ray.get(ready)
        except ray.exceptions.RayTaskError as error:
            raise RolloutError(f"an episode failed: {error.cause}") from error
        except ray.exceptions.RayError as error:
            raise RolloutError(f"an actor was lost: {str(error).strip().splitlines()[0]}") from error
        yield from episodes
