"""In-cycle tasks in the system file: what they become, and mistakes told with their place."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.config.conftest import SYSTEM, Home
from trocar.procs.document import system as document

TASK = "{module: mine.py, name: Mine}"


@pytest.fixture
def beside(home: Home) -> Path:
    file = home.path / "systems/mine.py"
    file.write_text("class Mine: ...\n")
    return file


def attach(home: Home, *tasks: str) -> int:
    """The demo with these tasks; returns the line of the first."""
    lines = "".join(f"\n      - {task}" for task in tasks)
    return home.edit(SYSTEM, "boards: emulated", f"boards: emulated\n  io:\n    tasks:{lines}") + 4


def test_a_task_is_found_beside_the_system_file(home: Home, beside: Path) -> None:
    attach(home, TASK, "{module: mine, name: Mine, robots: [PSM1], budget_us: 20.0, over_budget: 3, options: {a: [1]}}")
    loaded = home.load()
    assert loaded.errors == () and loaded.system is not None
    assert loaded.system.ios[0].tasks == (
        document.TaskRow(str(beside), "Mine", ("PSM1",), pytest.approx(50e-6), 10, {}),
        document.TaskRow(str(beside), "Mine", ("PSM1",), pytest.approx(20e-6), 3, {"a": [1]}),
    )
    assert document.from_json(document.to_json(loaded.system)) == loaded.system


def test_an_installed_module_keeps_its_name(home: Home) -> None:
    attach(home, "{module: json.decoder, name: JSONDecoder}")
    loaded = home.load()
    assert loaded.system is not None and loaded.system.ios[0].tasks[0].module == "json.decoder"


@pytest.mark.parametrize(("task", "key", "text", "allowed"), [
    ("{name: Mine}", "", "this key is required", "a .py file, or an importable module"),
    ("{module: mine.py}", "", "this key is required", "class or function"),
    ("{module: mine.py, name: Mine, robot: [PSM1]}", ".robot", 'did you mean "robots"', "budget_us"),
    ("{module: mine.py, name: 'Mine()'}", ".name", "not allowed", "class or function"),
    ("{module: yours.py, name: Mine}", ".module", "no such file", "systems"),
    ("{module: no_such_module, name: Mine}", ".module", "no such module", "installed"),
    ("{module: my-module, name: Mine}", ".module", "not the name of a module", ".py"),
    ("{module: mine.py, name: Mine, robots: [PSM2]}", ".robots[0]", "no joint controller of this name", "one of PSM1"),
    ("{module: mine.py, name: Mine, budget_us: 0}", ".budget_us", "out of range", "from 1.0 up to 1000.0 (µs)"),
    ("{module: mine.py, name: Mine, over_budget: 0}", ".over_budget", "out of range", "from 1 up to 1000"),
    ("{module: mine.py, name: Mine, over_budget: 1.5}", ".over_budget", "wrong type", "a whole number"),
    ("{module: mine.py, name: Mine, options: 3}", ".options", "wrong type", "an object"),
    ("{module: mine.py, name: Mine, options: {gain: .nan}}", ".options", "gain is no plain value", "no nan"),
    ("{module: mine.py, name: Mine, options: {gain: [1, {a: .inf}]}}", ".options", "gain is no plain", "no inf")])
def test_mistake_is_named_with_its_place(
        home: Home, beside: Path, task: str, key: str, text: str, allowed: str) -> None:
    line = attach(home, task)
    problem = home.error()
    assert problem.key.startswith(f"trocar.io.tasks[0]{key}") and problem.line == line - 1
    assert text in problem.text and allowed in problem.allowed
    assert problem.file == str(home.path / SYSTEM)


@pytest.mark.parametrize(("content", "text"), [(b"a = 1\nclass Mine(:\n", "mine.py line 2: "), (b"a = \0", "mine.py")])
def test_a_module_that_python_cannot_read_is_found_and_not_run(
        home: Home, beside: Path, content: bytes, text: str) -> None:
    beside.write_bytes(content)
    attach(home, "{module: mine.py, name: Mine}")
    problem = home.error()
    assert problem.key == "trocar.io.tasks[0].module" and text in problem.text


def test_budgets_leave_half_the_period_to_others(home: Home, beside: Path) -> None:
    attach(home, *["{module: mine.py, name: Mine, budget_us: 120}"] * 3)
    problem = home.error()
    assert problem.key == "trocar.io.tasks" and "add up to 360 µs" in problem.text and "333 µs" in problem.allowed
