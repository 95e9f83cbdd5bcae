"""Users' own code in the cycle: what it sees and adds, and that nothing it does reaches further."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from tests.io.harness import IoHarness
from trocar.procs.document.system import TaskRow
from trocar.procs.io.tasks import FORGIVEN_AFTER, TaskError

HEAD = """
import numpy as np
seen = []


class Mine:
    def __init__(self, robot):
        self.robot, self.steps, self.clock = robot, 0, None
        seen.append(self)

    def step(self, sample, effort):
        self.sample, self.effort = sample, effort
        self.steps += 1
"""


class TaskHarness(IoHarness):
    """A stand with one task whose step is `body`; it runs on the robots in `robots`."""

    def __init__(self, folder: Path, body: str, robots: tuple[str, ...] = ("PSM1",), count: int = 1, **changes) -> None:
        file = folder / "mine.py"
        file.write_text(HEAD + "".join(f"        {line}\n" for line in body.splitlines()))
        super().__init__(count, tasks=(TaskRow(str(file), "Mine", robots, **changes),))
        self.mine = [each.task for each in self.core.parts.tasks._attached]
        for each in self.mine:
            each.clock = self.clock

    @property
    def reported(self) -> list[str]:
        return [event.text for event in self.core.reports.events if "task-" in event.code]


def test_a_task_sees_the_sample_of_its_robot(tmp_path) -> None:
    harness = TaskHarness(tmp_path, "pass", robots=("PSM2",), count=2, options={"gain": 2.5, "axes": [1, 2]})
    harness.port.place(8, 0.25)
    harness.port.current(8, 0.5)
    harness.run(3)
    (mine,) = harness.mine
    assert mine.steps == 3 and mine.sample.stamp_ns == harness.core.stamp_ns
    np.testing.assert_allclose(mine.sample.position, 0.25 * (np.arange(7) == 1), atol=1e-9)
    np.testing.assert_allclose(mine.sample.current, 0.5 * (np.arange(7) == 1), atol=1e-3)
    np.testing.assert_allclose(mine.sample.setpoint_position, mine.sample.position)
    robot = mine.robot
    assert (robot.name, robot.period_s, robot.joint_types) == ("PSM2", 1 / 1500, ("REVOLUTE",) * 7)
    assert robot.axes == ("a",) * 7 and robot.options["gain"] == 2.5
    assert (robot.upper == 1.5).all() and (robot.maximum_effort == 2.0).all()


def test_its_efforts_are_added_in_the_same_cycle(tmp_path) -> None:
    harness = TaskHarness(tmp_path, "effort[...] = 3.0 * sample.position").control()
    harness.send(1, position=0.1)
    harness.port.place(0, 0.05)
    harness.run(1)
    np.testing.assert_allclose(harness.record.setpoint_effort, [0.05 + 0.15, *[0.1] * 6], atol=1e-9)
    np.testing.assert_allclose(harness.record.current_request, 0.5 * harness.record.setpoint_effort)


def test_efforts_start_from_zero_in_every_cycle(tmp_path) -> None:
    harness = TaskHarness(tmp_path, "effort[0] += 0.1").control()
    harness.run(5)
    np.testing.assert_allclose(harness.record.setpoint_effort, [0.1, 0, 0, 0, 0, 0, 0], atol=1e-12)


def test_no_task_can_exceed_the_limits(tmp_path) -> None:
    harness = TaskHarness(tmp_path, "effort[:4] = 1e300\neffort[4:] = -1e300").control()
    harness.run(1)
    assert harness.record.setpoint_effort.tolist() == [2.0] * 4 + [-2.0] * 3
    assert harness.record.current_request.tolist() == [1.0] * 4 + [-1.0] * 3


def test_nothing_is_added_while_the_joint_controller_is_off(tmp_path) -> None:
    harness = TaskHarness(tmp_path, "effort[...] = 1.0").power()
    harness.run(3)
    assert harness.mine[0].steps > 3 and not harness.mine[0].sample.enabled
    assert (harness.record.setpoint_effort == 0.0).all() and (harness.currents == 0x8000).all()
    harness.ask("pid_enable", 1)
    assert harness.mine[0].sample.enabled and (harness.record.setpoint_effort == 1.0).all()


def test_tasks_of_several_robots_do_not_meet(tmp_path) -> None:
    harness = TaskHarness(tmp_path, "effort[...] = 0.5 if self.robot.name == 'PSM1' else -0.25", ("PSM1", "PSM2"), 2)
    harness.control("PSM1")
    harness.control("PSM2")
    assert harness.record.setpoint_effort.tolist() == [0.5] * 7 + [-0.25] * 7


@pytest.mark.parametrize("name", ["position", "velocity", "current", "setpoint_position", "setpoint_velocity",
                                  "setpoint_effort", "effort_mode", "at_limit"])
def test_the_sample_cannot_be_written(tmp_path, name) -> None:
    harness = TaskHarness(tmp_path, f"sample.{name}[...] = 1").control()
    harness.run(2)
    assert harness.mine[0].steps == 1
    (text,) = harness.reported
    assert "mine.Mine: line" in text and "read-only" in text
    assert (harness.record.setpoint_position == 0.0).all() and (harness.record.setpoint_effort == 0.0).all()


@pytest.mark.parametrize(("body", "text"), [
    ("effort[2] = np.nan", "mine.Mine: effort nan"),
    ("effort[2] = np.inf", "mine.Mine: effort inf"),
    ("effort[...] = 1.0\nraise RuntimeError('lost')", "mine.Mine: line 16: RuntimeError: lost"),
    ("import sys\nsys.exit()", "SystemExit"),
    ("effort[7] = 1.0", "IndexError"),
])
def test_a_task_that_fails_is_detached_and_the_controller_goes_on(tmp_path, body, text) -> None:
    harness = TaskHarness(tmp_path, _late(body)).control()
    harness.send(1, position=0.1)
    while harness.mine[0].steps < 20:
        harness.run(1)
        np.testing.assert_allclose(harness.record.setpoint_effort, 0.1)
    harness.run(20)
    np.testing.assert_allclose(harness.record.setpoint_effort, 0.1)
    assert harness.mine[0].steps == 20
    (reported,) = harness.reported
    assert text in reported and "detached" in reported and harness.codes == ["task-failed"]
    (shown,) = harness.core.reports.detached
    assert shown.startswith("in-cycle task mine.Mine of PSM1 is detached: ")
    assert harness.record.pid_enabled[0] and harness.record.fault[0] == 0


def _late(body: str) -> str:
    return "if self.steps == 20:\n" + "\n".join(f"    {line}" for line in body.splitlines())


def test_over_budget_so_many_times_is_the_end(tmp_path) -> None:
    body = "effort[...] = 0.5\nself.clock.ns += 60_000"
    harness = TaskHarness(tmp_path, body, budget_s=50e-6, over_budget=10).control()
    assert harness.reported and harness.mine[0].steps == 10
    event = next(e for e in harness.core.reports.events if e.code == "task-over-budget")
    assert event.component == "PSM1" and event.value == pytest.approx(60e-6) and event.limit == pytest.approx(50e-6)
    assert "mine.Mine: mean 60.0 µs, at most 60.0 µs in 10 cycles" in event.text
    assert (harness.record.setpoint_effort == 0.0).all() and harness.record.pid_enabled[0]


@pytest.mark.parametrize("body", ["raise RuntimeError('x' * 500)", "self.clock.ns += 123_456_789"])
def test_a_long_reason_does_not_crowd_out_the_hint(tmp_path, body) -> None:
    harness = TaskHarness(tmp_path, body)
    harness.run(10)
    assert len(harness.reported) == 1
    (event,) = (e for e in harness.core.reports.events if e.code in ("task-over-budget", "task-failed"))
    assert "docs/in-cycle.md" in event.hint


@pytest.mark.parametrize(("every", "detached"), [(2, True), (FORGIVEN_AFTER, True), (FORGIVEN_AFTER + 1, False)])
def test_now_and_then_over_budget_is_forgiven(tmp_path, every, detached) -> None:
    harness = TaskHarness(tmp_path, f"if self.steps % {every} == 0:\n    self.clock.ns += 60_000", over_budget=3)
    harness.run(45 * every)
    assert bool(harness.reported) == detached


def test_times_are_told_when_the_joint_controller_goes_off(tmp_path) -> None:
    harness = TaskHarness(tmp_path, "self.clock.ns += 4_000 if sample.enabled else 9_000")
    assert harness.core.reports.events[0].text == "in-cycle task mine.Mine attached, budget 50 µs"
    harness.control()
    harness.run(5)
    harness.ask("pid_enable", 0)
    texts = [event.text for event in harness.core.reports.events if event.text.startswith("in-cycle task mine.Mine: ")]
    assert texts == ["in-cycle task mine.Mine: mean 4.0 µs, at most 4.0 µs in 6 cycles"]


def test_after_a_bad_read_no_task_runs(tmp_path) -> None:
    harness = TaskHarness(tmp_path, "effort[...] = 0.5").control()
    steps, harness.port.good = harness.mine[0].steps, False
    harness.run(2)
    assert harness.mine[0].steps == steps and (harness.record.setpoint_effort == 0.5).all()


@pytest.mark.parametrize(("source", "name", "text"), [
    ("def broken(:", "Mine", "cannot be loaded: SyntaxError"),
    ("\nimport no_such_module", "Mine", "cannot be loaded: line 2: ModuleNotFoundError"),
    ("raise SystemExit", "Mine", "cannot be loaded: line 1: SystemExit"),
    ("class Other: ...", "Mine", "no class or function Mine in"),
    ("def Mine(robot): raise KeyError('gain')", "Mine", "cannot be made for PSM1: line 1: KeyError: 'gain'"),
    ("def Mine(robot): return None", "Mine", "needs a method step(sample, effort)"),
    ("class Mine:\n def __init__(self, robot): ...\n def step(self, sample): ...", "Mine", "step(sample, effort)"),
])
def test_what_cannot_be_attached_is_said_at_the_start(tmp_path, source, name, text) -> None:
    file = tmp_path / "mine.py"
    file.write_text(source)
    with pytest.raises(TaskError) as error:
        IoHarness(tasks=(TaskRow(str(file), name, ("PSM1",)),))
    assert text in str(error.value) and "mine" in str(error.value)


def test_a_task_may_come_from_an_importable_module(tmp_path, monkeypatch) -> None:
    (tmp_path / "my_lab_task.py").write_text(HEAD + "        effort[...] = 0.5\n")
    monkeypatch.syspath_prepend(tmp_path)
    harness = IoHarness(tasks=(TaskRow("my_lab_task", "Mine", ("PSM1",)),)).control()
    assert (harness.record.setpoint_effort == 0.5).all()
    with pytest.raises(TaskError, match="no_such_module cannot be loaded: ModuleNotFoundError"):
        IoHarness(tasks=(TaskRow("no_such_module", "Mine", ("PSM1",)),))
