"""CONTRIBUTING.md: recipes name the files that the tests touch which follow them, and its commands can be given."""

from __future__ import annotations

import re
import sys
import tomllib
from pathlib import Path

import pytest

from tests.cases import cases
from tests.system.test_added_arm import SCOPE
from tests.system.test_added_kind import METRONOME

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
RECIPES = {int(number): (title, body)
           for number, title, body in re.findall(r"^## (\d+)\. (.*)\n((?:(?!^## ).*\n)*)", PAGE, re.MULTILINE)}
MARKS = {row.split(":")[0] for row in tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
         ["tool"]["pytest"]["ini_options"]["markers"]}
COMMANDS = [line for line in (*re.findall(r"^    (\S.*)$", PAGE, re.MULTILINE), *re.findall(r"`([^`\n]+)`", PAGE))
            if re.match(r"(tools/test|\.ci/run|\.venv/bin/)", line)]


def steps(number: int) -> list[str]:
    """The first file of each step of a recipe."""
    return re.findall(r"^\d+\. `([^`]+)`", RECIPES[number][1], re.MULTILINE)


def test_there_are_ten_recipes_with_tests() -> None:
    assert list(RECIPES) == list(range(1, 11))
    assert not [title for title, body in RECIPES.values() if "`tests/" not in body]


@pytest.mark.parametrize(("number", "recipe"), [(2, SCOPE), (6, METRONOME)])
def test_a_recipe_names_the_files_of_the_test_that_follows_it(number: int, recipe: dict[str, object]) -> None:
    assert {name.replace("KIND", "metronome") for name in steps(number)} == set(recipe)


@cases("number", [number for number, (title, _) in RECIPES.items() if "file" in title])
def test_a_recipe_counts_its_files(number: int) -> None:
    title, body = RECIPES[number]
    (count,) = re.findall(r": (\d) file", title)
    assert int(count) <= 4 and int(count) + ("the page" in title) == len(re.findall(r"^\d+\. ", body, re.MULTILINE))


def test_every_mark_is_in_the_table() -> None:
    assert set(re.findall(r"^\| `(\w+)` \|", PAGE, re.MULTILINE)) == MARKS


def test_fixtures_and_harnesses_are_in_the_files_named_with_them() -> None:
    named = re.findall(r"`(\w+)`(?: and `(\w+)`)?[^`(]{0,20}\(`(tests/[\w/]+\.py)`", PAGE)
    assert len(named) >= 7
    for first, second, file in named:
        text = (ROOT / file).read_text(encoding="utf-8")
        assert all(re.search(rf"^(class|def) {name}\b", text, re.MULTILINE) for name in (first, second) if name), file


@cases("line", COMMANDS)
def test_a_command_of_the_page_can_be_given(line: str) -> None:
    for command in line.split(" && "):
        program, *words = re.findall(r'"[^"]*"|\S+', command)
        there = Path(sys.executable).parent if program.startswith(".venv/") else ROOT
        assert (there / (Path(program).name if there != ROOT else program)).is_file(), program
        asked = command.partition("-m ")[2]
        expression = re.match(r'"([^"]*)"|(\w*)', asked)
        assert expression and set(re.findall(r"\w+", expression[0])) <= MARKS | {"not", "and", "or"}
        assert all((ROOT / word.replace("FOLDER", "arm")).exists() for word in words if word.startswith("tests/"))
