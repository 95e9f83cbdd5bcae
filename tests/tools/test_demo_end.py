"""The end of `trocar demo`: what it did not show it does not call shown."""

from __future__ import annotations

import contextlib
import json
from types import SimpleNamespace
from typing import Any, cast

import pytest
from typer.testing import CliRunner

from tests.conftest import World
from tests.tools.robot import robot
from trocar.shm.memory.segment import SegmentError
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.system_time import SystemTime
from trocar.tools import cli
from trocar.tools.output.errors import Problem
from trocar.tools.systems.supervising import Background
from trocar.tools.verbs import demo
from trocar.tools.verbs.demo import MOST, _draw, judged


class Idle:
    """A hand, a teleoperation, or whoever looks at them; nothing happens."""

    def __getattr__(self, name: str) -> Any:
        return lambda *values: None


def test_a_demo_that_a_busy_machine_left_no_time_says_so_as_a_problem() -> None:
    idle: Any = Idle()
    with SystemTime("") as time, pytest.raises(Problem, match=r"ended after 0\.0 of 3 s: this machine is busy"):
        _draw(idle, idle, (idle, idle), 3.0, [0], time, monotonic_ns(), lambda text: None)


def test_what_is_only_late_in_real_time_is_no_problem_but_an_error_and_a_lost_slave_are() -> None:
    run = {**dict.fromkeys(MOST, 1.0), "latency_ms_p99": 90.0, "late": ["IO1 ran at 300 Hz"], "problems": []}
    late = judged(run, "", simulated=False)
    assert late["problems"] == [] and len(late["late"]) == 2
    assert len(judged(run, "", simulated=True)["problems"]) == 2
    assert judged({**run, "problems": ["PSM1: tracking"]}, "MTMR_PSM1 waits", simulated=False)["problems"] == [
        "PSM1: tracking", "MTMR_PSM1 waits"]


class StoppedSupervisor:
    """A supervisor that another terminal has stopped."""

    popen = SimpleNamespace(returncode=0)

    def state(self) -> str:
        """It has no shared memory any more."""
        return ""


def test_a_demo_that_is_stopped_from_outside_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def gone(*_: object) -> None:
        raise SegmentError("/trocar~demo~console~mailbox: no such segment")

    monkeypatch.setattr(demo, "up_meanwhile", lambda *_: contextlib.nullcontext(StoppedSupervisor()))
    for name in ("web_addresses", "_bring_up"):
        monkeypatch.setattr(demo, name, lambda *_: [])
    for name in ("_operate", "bring_all"):
        monkeypatch.setattr(demo, name, lambda *_, **__: gone())
    result = CliRunner().invoke(cli.build("demo"), ["demo", "--json"])
    assert result.exit_code == 1 and json.loads(result.stdout)["problems"] == [demo.STOPPED]


def test_a_demo_whose_system_is_now_another_one_of_its_name_reports_and_powers_off_nothing_of_that(
        world: World, monkeypatch: pytest.MonkeyPatch) -> None:
    background = Background.__new__(Background)
    background.system, background.popen = world.name, cast(Any, SimpleNamespace(pid=1, returncode=0))
    asked: list[object] = []
    monkeypatch.setattr(demo, "up_meanwhile", lambda *_: contextlib.nullcontext(background))
    for name in ("web_addresses", "_bring_up"):
        monkeypatch.setattr(demo, name, lambda *_: [])
    monkeypatch.setattr(demo, "_operate", lambda *_: {"problems": ["PSM1: a fault of the next one", "PSM1 is silent"]})
    monkeypatch.setattr(demo, "bring_all", lambda *values, **_: asked.append(values))
    with robot(world.name) as next_one:
        assert next_one.pages["supervisor"].state == "RUNNING"
        result = CliRunner().invoke(cli.build("demo"), ["demo", "--json", "--system", world.name])
    assert result.exit_code == 1 and json.loads(result.stdout)["problems"] == [demo.STOPPED] and not asked


@pytest.mark.parametrize("is_there", [True, False])
def test_a_demo_without_the_console_package_has_no_console(is_there: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    requests: list[Any] = []
    monkeypatch.setattr(demo, "up_meanwhile", lambda request, _: (
        requests.append(request), contextlib.nullcontext(StoppedSupervisor()))[1])
    for name in ("web_addresses", "_bring_up"):
        monkeypatch.setattr(demo, name, lambda *_: [])
    monkeypatch.setattr(demo, "_operate", lambda *_: {"problems": []})
    monkeypatch.setattr(demo, "missing", lambda _: "" if is_there else "the web console needs starlette")
    result = CliRunner().invoke(cli.build("demo"), ["demo", "--json"])
    assert any(value.startswith("gui") for value in requests[0].sets) == is_there
    assert ("the web console needs starlette" in result.stderr) != is_there
    if not is_there:
        result = CliRunner().invoke(cli.build("demo"), ["demo", "--listen", "0.0.0.0:8080"])
        assert result.exit_code == 1 and len(requests) == 1
