"""The configuration is read by a process that ends, so that what it needed does not stay in the supervisor."""

from __future__ import annotations

import argparse
import logging
import os
import signal
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.conftest import World
from trocar.procs.document.system import SystemConfig, to_json
from trocar.procs.machine.free_port import reserve
from trocar.procs.machine.paths import PROJECT_CONFIGS
from trocar.procs.supervisor.configuration import Configuration

pytestmark = pytest.mark.slow
FILE = PROJECT_CONFIGS / "systems" / "kinematic.yaml"


def options(world: World, file: Path = FILE, **more: object) -> argparse.Namespace:
    return argparse.Namespace(**{"file": file, "system": world.name, "boards": None, "path": [], "sets": [],
                                 "document": False, **more})


def test_ports_and_domains_stay_reserved_after_its_end(world: World) -> None:
    with ExitStack() as held:
        system = Configuration(options(world, sets=["ros={}"])).document(held)
        assert isinstance(system, SystemConfig) and system.name == world.name and system.ros is not None
        domain = system.ros.domain
        with pytest.raises(OSError, match="are all in use"):
            reserve("ROS domain", domain, domain)
    reserve("ROS domain", domain, domain)[1].close()


def test_the_document_of_a_recording_gets_the_name_of_the_new_system(world: World, tmp_path: Path) -> None:
    with ExitStack() as held:
        first = Configuration(options(world)).document(held)
        assert first is not None
        (tmp_path / "document.json").write_bytes(to_json(first))
        again = Configuration(options(world, tmp_path / "document.json", document=True, system="x")).document(held)
    assert again is not None and again.name == "x" and again.arms == first.arms


def test_it_reports_errors_itself(
    world: World, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(logging.getLogger(), "handlers", [])  # a supervisor has none yet
    with ExitStack() as held:
        assert Configuration(options(world, tmp_path / "no-such-file.yaml")).document(held) is None
    assert "no-such-file.yaml" in capfd.readouterr().err


def test_its_sudden_end_is_reported(world: World, caplog: pytest.LogCaptureFixture) -> None:
    with ExitStack() as held:
        reader = Configuration(options(world))
        os.kill(reader._pid, signal.SIGKILL)
        assert reader.document(held) is None
    assert "exit code -9" in caplog.text


@pytest.mark.parametrize(("does", "never"), [
    ("import trocar.procs.supervisor.configuration, trocar.procs.supervisor.run", "pydantic yaml trocar.procs.config"),
    ("from trocar.procs.supervisor.template import import_loops; import_loops()",
     "pydantic yaml mujoco asyncio trocar.procs.config"),
])
def test_libraries_of_few_processes_are_not_in_all(does: str, never: str) -> None:
    code = f"import sys\n{does}\nprint(*(name for name in {never.split()} if name in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == ""
