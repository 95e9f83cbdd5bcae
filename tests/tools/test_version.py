"""Which version this is, wherever somebody asks."""

from __future__ import annotations

import subprocess
import sys
import tomllib

import trocar
from trocar.procs.machine.paths import ROOT


def test_every_place_says_the_version_of_the_project() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    reported = subprocess.run([sys.executable, "-m", "trocar", "--version"], cwd=ROOT, capture_output=True, text=True,
                              check=True).stdout
    assert trocar.__version__ == project["version"]
    assert reported.startswith(f"trocar {project['version']} ({ROOT}, Python 3")
