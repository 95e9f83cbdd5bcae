"""Verbs that start a system of their own leave nothing behind, also when they are killed with kill -9."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.conftest import World
from tests.system.robot import wait_for
from trocar.procs.machine.paths import ROOT
from trocar.shm.memory.segment import names_of
from trocar.tools.systems.cleanup import own_folder
from trocar.tools.systems.find import is_up
from trocar.tools.systems.processes import running


def left(prefix: str, folder: Path) -> list[str]:
    """Processes, segments, and files in the folder for temporary ones."""
    segments = ["~".join(parts) for parts in names_of() if parts[0].startswith(prefix)]
    return segments + [str(row) for row in running() if row.system.startswith(prefix)] + [
        str(path) for path in folder.iterdir()]


def killed(words: list[str], folder: Path, at_work: Callable[[int], bool]) -> int:
    """Start a verb, kill it when it is at work; its pid."""
    environment = {**os.environ, "TMPDIR": str(folder), "TROCAR_STATE": str(folder.parent / "state")}
    verb = subprocess.Popen([sys.executable, "-m", "trocar", *words], cwd=ROOT, env=environment,
                            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        wait_for(lambda: at_work(verb.pid), 60, f"{words} at work")
    finally:
        verb.kill()
        verb.wait()
    return verb.pid


@pytest.mark.slow
@pytest.mark.parametrize(("words", "system"), [
    (["bench", "lifecycle"], "bench-lifecycle-{}"), (["bench", "deaths"], "bench-deaths-{}")])
def test_a_killed_verb_leaves_nothing_of_its_system(words: list[str], system: str, tmp_path: Path) -> None:
    folder = tmp_path / "temporary"
    folder.mkdir()
    pid = killed(words, folder, lambda pid: is_up(system.format(pid)) and len(running(system.format(pid))) > 2)
    wait_for(lambda: not left(system.format(pid), folder), 40, f"nothing left: {left(system.format(pid), folder)}")


@pytest.mark.slow
def test_a_verb_killed_with_its_supervisor_leaves_nothing(tmp_path: Path) -> None:
    folder = tmp_path / "temporary"
    folder.mkdir()

    def at_work(pid: int) -> bool:
        found = running(f"bench-io-{pid}")
        if len(found) > 2:
            found[0].send(signal.SIGKILL)
        return len(found) > 2

    pid = killed(["bench", "io"], folder, at_work)
    wait_for(lambda: not left(f"bench-io-{pid}", folder), 40, "nothing left")


@pytest.mark.slow
@pytest.mark.parametrize(("name", "prefix"), [("ring", "bench{}-"), ("arm", "bench-arm-{}")])
def test_a_killed_measurement_leaves_no_shared_memory(name: str, prefix: str, tmp_path: Path) -> None:
    folder = tmp_path / "temporary"
    folder.mkdir()

    def at_work(pid: int) -> bool:
        return any(parts[0].startswith(prefix.format(pid)) for parts in names_of())

    pid = killed(["bench", name], folder, at_work)
    wait_for(lambda: not left(prefix.format(pid), folder), 40, f"nothing left: {left(prefix.format(pid), folder)}")


def test_what_ends_well_needs_no_cleaning(world: World) -> None:
    with own_folder(world.name) as folder:
        (folder / "file").write_text("x")
    assert not folder.exists()
