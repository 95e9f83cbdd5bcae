"""Every place states the version of procs/machine/version.py."""

from __future__ import annotations

import re
import subprocess
import sys

import yaml
from hatchling.metadata.core import ProjectMetadata
from hatchling.plugin.manager import PluginManager

import trocar
from trocar.procs.machine.paths import ROOT


def test_every_place_states_the_same_version() -> None:
    reported = subprocess.run([sys.executable, "-m", "trocar", "--version"], cwd=ROOT, capture_output=True, text=True,
                              check=True).stdout
    newest = re.search(r"^## (\d\S*)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE)
    assert newest is not None and newest[1] == trocar.__version__
    assert ProjectMetadata(str(ROOT), PluginManager()).version == trocar.__version__
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == trocar.__version__
    assert reported.startswith(f"trocar {trocar.__version__} ({ROOT}, Python 3")
