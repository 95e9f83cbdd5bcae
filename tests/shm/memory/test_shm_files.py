"""Shared memory without posix_ipc, which has no wheel for every Python."""

from __future__ import annotations

import subprocess
import sys

import pytest

from tests.conftest import ROOT

WITHOUT = """
import sys
sys.modules["posix_ipc"] = None
import pytest
code = pytest.main(["-q", "-p", "no:cacheprovider", "tests/shm/memory/test_segment.py"])
from trocar.shm.memory import shm_files
assert hasattr(shm_files, "_posixshmem")
sys.exit(code)
"""


@pytest.mark.slow
def test_segments_are_the_same_without_posix_ipc() -> None:
    done = subprocess.run([sys.executable, "-c", WITHOUT], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
