"""The tutorials of docs/tutorials, step by step as they stand: files are written, commands typed."""

from __future__ import annotations

import re
import shlex
import shutil
import sys

import pytest

from tests.system.robot import ROOT
from tests.system.test_examples import Person, person
from tests.system.test_ros_itself import HAS_ROS, PYTHON, environment

__all__ = ["person"]
pytestmark = [pytest.mark.slow, pytest.mark.simulated]
PAGES = {page.stem: page.read_text(encoding="utf-8") for page in (ROOT / "docs" / "tutorials").glob("*.md")}
STEP = re.compile(r"^```(?:python|yaml)\n# (?P<name>\S+)\n(?P<text>(?s:.*?))^```|^    (?P<line>\S.*)$", re.MULTILINE)
TYPED_ELSEWHERE = re.compile(r"pip install |trocar commission ")  # pyproject.toml; tests/system/test_commission.py
ROS_DOMAIN = 42


def follow(person: Person, page: str, python: str = sys.executable) -> int:
    """Take every step of a page; returns how many commands were typed."""
    shutil.copytree(ROOT / "configs", person.folder / "configs")  # a page changes them
    typed = 0
    for step in STEP.finditer(re.sub(r"^```sh\n(?s:.*?)^```", "", PAGES[page], flags=re.MULTILINE)):
        line = step["line"]
        if step["name"]:
            (person.folder / step["name"]).write_text(step["text"])
        elif line.startswith("export "):
            person.environment |= dict(word.split("=") for word in shlex.split(line)[1:])
        elif not TYPED_ELSEWHERE.match(line):
            person.types(re.sub(r"\bpython3?(?= )", python, line))
            typed += 1
    return typed


@pytest.mark.parametrize("page", sorted(PAGES.keys() - {"ros"}))
def test_a_tutorial_works_as_it_stands(person: Person, page: str) -> None:
    assert follow(person, page) > 5


@pytest.mark.peers
@pytest.mark.skipif(not HAS_ROS, reason="no rclpy: tools/peers installs it")
def test_the_tutorial_of_ros_works_as_it_stands(person: Person) -> None:
    person.environment |= environment(ROS_DOMAIN)
    assert follow(person, "ros", str(PYTHON)) > 3
