"""The example of docs/in-cycle.md is loaded, attached and run as it stands on the page."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from tests.conftest import ROOT
from tests.io.harness import IoHarness, gains
from trocar.procs.config import load_system
from trocar.procs.config.models.trocar_section import TaskKeys
from trocar.procs.config.read.yamltext import parse_yaml
from trocar.procs.document.system import PidConfig, TaskRow
from trocar.procs.document.tasks import Sample, TaskRobot
from trocar.procs.io.tasks import TaskError
from trocar.procs.tables.codes import FAULTS

PAGE = (ROOT / "docs/in-cycle.md").read_text()
DEMO = ROOT / "configs/systems/demo.yaml"
NAMES = ("yaw", "pitch", "insertion", "disc_1", "disc_2", "disc_3", "disc_4")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture
def task(tmp_path: Path) -> TaskRow:
    """The page's system file on top of the demo, with the page's module beside it."""
    (code,), (options,) = blocks("python"), blocks("yaml")
    (tmp_path / "wall.py").write_text(code)
    (tmp_path / "lab.yaml").write_text(DEMO.read_text() + options.removeprefix("trocar:\n"))
    loaded = load_system(tmp_path / "lab.yaml")
    assert loaded.errors == () and loaded.warnings == () and loaded.system is not None
    (found,) = loaded.system.ios[0].tasks
    return found


def stand_with(task: TaskRow) -> IoHarness:
    named = tuple(gains(name=name, p_gain=0.0) for name in NAMES)
    return IoHarness(tasks=(task,), pids=(PidConfig("PSM1", "PSM1", named),)).control()


def test_the_example_pushes_back_and_never_pulls(task: TaskRow) -> None:
    harness = stand_with(task)
    for position, effort in ((0.0, 0.0), (0.3, 0.0), (0.31, -0.4), (0.32, -0.8), (0.4, -2.0), (0.29, 0.0)):
        harness.port.place(0, position)
        harness.run(1)
        np.testing.assert_allclose(harness.record.setpoint_effort, [effort, *[0.0] * 6], atol=1e-6)
    assert not harness.codes


def test_the_example_damps(task: TaskRow) -> None:
    harness = stand_with(task)
    mine = harness.core.parts.tasks._attached[0].task
    robot = TaskRobot("PSM1", NAMES, ("REVOLUTE",) * 7, 1 / 1500, *(np.full(7, x) for x in (-1.5, 1.5, 2.0)),
                      task.options)
    sample = Sample(*(np.zeros(7) for _ in range(6)), *(np.zeros(7, dtype=bool) for _ in range(2)))
    sample.velocity[0], effort = 0.5, np.zeros(7)
    type(mine)(robot).step(sample, effort)
    np.testing.assert_allclose(effort, [-0.25, 0, 0, 0, 0, 0, 0])


def test_options_the_example_cannot_use_are_refused(task: TaskRow) -> None:
    for changes, text in (({"at": 2.0}, "outside the joint's limits"),
                          ({"axis": "elbow"}, "PSM1 has no axis elbow; there are: yaw, pitch, ")):
        wrong = TaskRow(task.module, task.name, task.robots, task.budget_s, 10, {**task.options, **changes})
        with pytest.raises(TaskError, match=text):
            stand_with(wrong)


def test_the_page_names_every_key_and_code() -> None:
    assert all(f"| `{name}` |" in PAGE for name in TaskKeys.model_fields)
    assert all(f"`{row.code}`" in PAGE for row in FAULTS if row.code.startswith("task-"))
    assert "trocar" in parse_yaml(blocks("yaml")[0]).data
