"""The examples of docs/python.md and of the README run as they stand there."""

from __future__ import annotations

import re
import subprocess
import sys

import pytest

from tests.system.robot import ROOT, Robot

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
EXAMPLE = re.compile(r"^    trocar up (\S+)\n\n```python\n(.*?)```", re.DOTALL | re.MULTILINE)
PAGE = EXAMPLE.findall((ROOT / "docs/python.md").read_text())
README = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
EXAMPLES = [*PAGE, *(("configs/systems/kinematic.yaml", code) for code in README)]


def test_there_are_examples_of_every_kind() -> None:
    assert len(EXAMPLES) == 4


@pytest.mark.parametrize(("file", "code"), EXAMPLES, ids=["psm", "master", "cart", "readme"])
def test_the_example_runs(robot: Robot, file: str, code: str) -> None:
    robot.up(ROOT / file, "--set", "clock=lockstep")
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, env=robot.environment, timeout=120, text=True,
                          capture_output=True, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stderr == ""
