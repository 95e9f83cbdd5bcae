"""A real file system that is full, and has room again."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.system.robot import ROOT

ON_A_SMALL_DISK = """
mount -t tmpfs -o size=32m tmpfs {folder} || exit 99
{python} -m tests.recorder.small_disk {system} {folder}
"""


@pytest.mark.slow
@pytest.mark.patient
def test_a_recorder_goes_on_when_a_full_disk_has_room_again(world: Any, tmp_path: Path) -> None:
    if subprocess.run(["unshare", "-m", "true"], capture_output=True, check=False).returncode:
        pytest.skip("a mount namespace of one's own is not permitted here")
    folder = tmp_path / "disk"
    folder.mkdir()
    script = ON_A_SMALL_DISK.format(folder=folder, python=sys.executable, system=world.name)
    done = subprocess.run(["unshare", "-m", "--propagation", "private", "sh", "-c", script], cwd=ROOT, text=True,
                          capture_output=True, timeout=120, check=False,
                          env={**os.environ, "TROCAR_STATE": str(tmp_path), "PYTHONPATH": str(ROOT)})
    if done.returncode == 99:
        pytest.skip("mounting is not permitted here")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    assert found["before"]["dropped"] == 0 and not found["before"]["problem"]
    assert "No space left on device" in found["full"]["problem"] and found["told"]
    assert found["later"]["dropped"] == found["again"]["dropped"] >= found["full"]["dropped"]
    for whole, problems, count in found["files"].values():
        assert whole and not problems and count > 5
    assert set(found["files"]) == {"box", "grasp", "fault"}, "also what was begun while it was full"
    assert found["not_kept"] == ["", True]
    assert not found["before"]["error"] and "nothing is recorded" in found["full"]["error"]
    assert "the last fault was not recorded: No space left" in found["later"]["error"]
    assert Path(found["kept"]).name.startswith("fault-")
