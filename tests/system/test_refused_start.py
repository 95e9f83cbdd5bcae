"""What `trocar up` says where something outside is in its way: in few words, with what helps."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest

from tests.conftest import World
from trocar.procs.machine.paths import ROOT, log_folder
from trocar.shm.memory.segment import names_of

pytestmark = [pytest.mark.slow, pytest.mark.patient]
KINEMATIC = ROOT / "configs" / "systems" / "kinematic.yaml"


def typed(folder: Path, *words: str, files: tuple[int, int] | None = None) -> subprocess.CompletedProcess[str]:
    """A verb with its logs in `folder`; `files`: limits of open files, as a shell sets them."""
    environment = {**os.environ, "TROCAR_STATE": str(folder)}
    environment.pop("TROCAR_SYSTEM", None)
    return subprocess.run([sys.executable, "-m", "trocar", *words], cwd=ROOT, env=environment, capture_output=True,
                          text=True, timeout=120, check=False,
                          preexec_fn=(lambda: resource.setrlimit(resource.RLIMIT_NOFILE, files)) if files else None)


@pytest.mark.skipif(any(Path("/dev").glob("fw*")), reason="this machine has FireWire")
def test_a_missing_firewire_card_is_one_line_of_the_log_and_its_remedies_name_the_system(
        tmp_path: Path, world: World) -> None:
    file = tmp_path / "real.yaml"
    file.write_text((ROOT / "configs/systems/demo.yaml").read_text().replace("boards: emulated", "boards: real")
                    .replace("port: udp", "port: fw"))
    refused = typed(tmp_path, "up", str(file), "--system", world.name)
    assert refused.returncode == 1
    assert "fw:0: this machine has no FireWire card" in refused.stderr
    assert "--boards emulated" in refused.stderr and f"trocar logs IO1 --system {world.name}" in refused.stderr
    log = (log_folder({"TROCAR_STATE": str(tmp_path)}, world.name) / "IO1.log").read_text()
    assert "no FireWire card" in log and "Traceback" not in log


def test_a_soft_limit_of_open_files_is_raised_and_a_hard_one_refuses_before_anything_starts(
        tmp_path: Path, world: World) -> None:
    words = ("up", str(KINEMATIC), "--system", world.name, "--set", "recorder.on=true")
    hard = resource.getrlimit(resource.RLIMIT_NOFILE)[1]
    assert typed(tmp_path, *words, "--for", "0.5", files=(64, hard)).returncode == 0
    refused = typed(tmp_path, *words, files=(64, 256))
    assert refused.returncode == 1 and names_of(world.name) == []
    assert "a process may open 256 files at most" in refused.stderr and "--nofile=1024:1024" in refused.stderr
