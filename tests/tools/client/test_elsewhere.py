"""`import trocar` where there is no shared memory of ours: Python and numpy are enough."""

from __future__ import annotations

import subprocess
import sys

from tests.conftest import ROOT

WITHOUT = """
import sys

ABSENT = {"posix_ipc", "_posixshmem", "fcntl", "grp", "pwd", "mujoco", "pinocchio", "psutil", "pydantic", "yaml",
          "typer", "rich", "websockets", "cyclonedds"}

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in ABSENT:
            raise ModuleNotFoundError(f"no module {name}", name=name)

sys.meta_path.insert(0, Absent())
sys.platform = "darwin"
import time
for name in ("CLOCK_BOOTTIME", "CLOCK_REALTIME", "CLOCK_MONOTONIC"):  # Windows has none of them
    delattr(time, name)
del time.clock_gettime_ns
import trocar
try:
    trocar.arm("PSM1")
except trocar.Problem as error:
    print(error)
try:
    trocar.psm("PSM1", at="127.0.0.1:1", timeout=0.1)
except TimeoutError as error:
    print(error)
print({name.split(".")[0] for name in sys.modules} & ABSENT)
"""


def test_trocar_needs_python_and_numpy_only() -> None:
    done = subprocess.run([sys.executable, "-c", WITHOUT], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    first, second, loaded = done.stdout.splitlines()
    assert "this needs the robot's own machine" in first and "127.0.0.1:1 is not connected" in second
    assert loaded == "set()"
