"""The examples of docs/python.md run as they stand there; that of the README does in test_examples.py."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from tests.system.robot import ROOT, Robot

pytestmark = [pytest.mark.slow, pytest.mark.simulated("paced")]
EXAMPLE = re.compile(r"^    trocar up (\S+)\n\n```python\n(.*?)```", re.DOTALL | re.MULTILINE)
PAGE = EXAMPLE.findall((ROOT / "docs/python.md").read_text())


def test_there_are_examples_of_every_kind() -> None:
    assert len(PAGE) == 4


@pytest.mark.parametrize(("file", "code"), PAGE, ids=["psm", "master", "cart", "events"])
def test_the_example_runs(robot: Robot, file: str, code: str) -> None:
    robot.up(ROOT / file)
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=robot.environment, timeout=120, text=True,
                          capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
