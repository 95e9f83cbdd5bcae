"""The problem that status shows of a process, by its control page and by what the supervisor knows of it."""

from __future__ import annotations

from typing import Any
from unittest.mock import Mock

import pytest

from trocar.procs.document.process import Process
from trocar.shm.time.control_page import STATES
from trocar.tools.inspect.processes import SENTENCES, ProcessStatus, _in_slow_time, _problem
from trocar.tools.inspect.standing import first_thing


class SilentPage:
    """A control page that shows an error, and no life."""

    def get(self, name: str) -> Any:
        return b"no sensor" if name == "error" else 0


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("lives", [True, False])
@pytest.mark.parametrize("kind", ["supervisor", "arm"])
def test_each_state_of_a_process_has_its_words(state: str, lives: bool, kind: str) -> None:
    page: Any = SilentPage()
    problem = _problem(Process("force", kind, 0.0), state, lives, page, simulated=False, exit_reason="", lifecycle="")
    assert problem.partition(":")[0] in {"", "no sensor", *SENTENCES}
    assert bool(problem) >= (kind == "supervisor" and not lives), "it is never well without one"


@pytest.mark.parametrize(("reason", "on_exit", "lifecycle", "problem"), [
    ("exit code 0: its main has returned", "restart", "STOPPED", "not running: exit code 0: its main has returned"),
    ("exit code 0: its main has returned", "stay-down", "STOPPED", ""),
    ("exit code 4", "restart", "RUNNING", ""), ("stopped", "restart", "STOPPED", ""),
    ("stopped: did not end within 3 s, killed", "restart", "STOPPED", ""), ("done", "restart", "STOPPED", ""),
    ("", "restart", "STOPPED", ""), ("exit code 4", "restart", "RESTARTING", "")])
def test_who_has_ended_by_itself_does_not_run_unless_its_row_lets_it_end(
        reason: str, on_exit: str, lifecycle: str, problem: str) -> None:
    page: Any = SilentPage()
    row = Process("force", "user", 0.0, on_exit=on_exit)
    assert _problem(row, "STOPPED", False, page, simulated=False, exit_reason=reason, lifecycle=lifecycle) == problem


@pytest.mark.parametrize("state", ["CREATED", "FAILED", "STOPPED"])
@pytest.mark.parametrize("lifecycle", ["RUNNING", "RESTARTING"])
def test_one_that_the_supervisor_starts_again_has_no_problem(state: str, lifecycle: str) -> None:
    page: Any = SilentPage()
    row = Process("force", "user", 0.0)
    assert not _problem(row, state, False, page, simulated=False, exit_reason="killed by SIGKILL", lifecycle=lifecycle)


@pytest.mark.parametrize(("kind", "period_s", "problem"), [
    ("io", 0.00133, ""),
    ("arm", 0.004, "runs at 250 Hz instead of 1500: this machine is too slow (trocar doctor)"),
    ("user", 0.004, "")])
def test_on_the_wall_clock_half_of_the_rate_is_not_well(kind: str, period_s: float, problem: str) -> None:
    page = Mock(get={"error": b"", "period_avg": period_s, "heartbeat_ns": 0}.__getitem__)
    row = Process("PSM1", kind, 1 / 1500)
    assert _problem(row, "RUNNING", True, page, simulated=False, exit_reason="", lifecycle="RUNNING") == problem
    assert not _problem(row, "RUNNING", True, page, simulated=True, exit_reason="", lifecycle="RUNNING")


@pytest.mark.parametrize(("silent_s", "problem", "rate_hz"), [
    (0.9, "silent for 0.9 s; simulated time waits for it", None), (0.2, "its cycles take so long", 500.0)])
def test_of_a_silent_process_no_cycles_are_said_to_take_long(
        silent_s: float, problem: str, rate_hz: float | None) -> None:
    rows = [ProcessStatus(name, "arm", "RUNNING", rate_hz=500.0, silent_s=silent_s) for name in ("PSM1", "PSM2")]
    slow, other = _in_slow_time(rows, "PSM1", 0.0)
    assert slow.problem.startswith(problem) and not other.problem and slow.rate_hz == other.rate_hz == rate_hz


def test_a_death_that_the_supervisor_has_not_seen_needs_no_command() -> None:
    dead = ProcessStatus("nudge", "user", "DEAD", problem="dead", lifecycle="RUNNING", lives=False)
    assert "trocar start" not in first_thing([dead], [])
