"""Rows of "Environments" in docs/platforms.md that need a whole system: folders, colours, two systems, ends."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.system.conftest import systems
from tests.system.robot import COARSE, ROOT, Robot
from trocar.shm.memory.segment import names_of

pytestmark = [pytest.mark.slow, pytest.mark.simulated("paced")]
KINEMATIC = ROOT / "configs" / "systems" / "kinematic.yaml"
NO_SYSTEM = {"TROCAR_SYSTEM": "", "NO_COLOR": "1", "FORCE_COLOR": "1"}


@pytest.fixture
def made(tmp_path: Path) -> Iterator[Callable[[], Robot]]:
    """A maker of systems that keep all files in a folder with a space and umlauts."""
    (folder := tmp_path / "Prüfstand für Ärzte").mkdir()
    with systems(folder, "paced") as make:
        yield make


def test_systems_in_any_folder_are_told_apart_and_end_in_order(made: Callable[[], Robot]) -> None:
    first, second = made(), made()
    for robot in (first, second):
        file = robot.logs / "ein Arm.yaml"
        file.write_text(KINEMATIC.read_text().replace("arms/", f"{ROOT}/configs/arms/"))
        robot.up(file, *COARSE)
        robot.environment |= NO_SYSTEM
    first.insist("home", "PSM1", "--system", first.name)

    refused = first.trocar("status", code=1)
    assert "several systems are up" in refused and first.name in refused and second.name in refused
    assert "\x1b" not in refused + first.trocar("status", "--system", first.name)
    assert list(first.logs.rglob("PSM1.log"))

    assert first.supervisor is not None and second.supervisor is not None
    first.supervisor.send_signal(signal.SIGHUP)  # its terminal was closed
    assert first.supervisor.wait(60) == 0 and "stopping: got SIGHUP" in first.output()
    assert names_of(first.name) == []
    assert second.name in second.trocar("status", "--system", second.name)
    for _ in range(2):  # Ctrl-C twice
        second.supervisor.send_signal(signal.SIGINT)
    assert second.supervisor.wait(60) == 0 and second.output().count("stopping: got SIGINT") == 1
    assert names_of(second.name) == []
