"""The problem that status shows of a process, by its control page and by what the supervisor knows of it."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any
from unittest.mock import Mock

import pytest

from trocar.procs.document.process import Process
from trocar.shm.time.control_page import STATES
from trocar.tools.inspect.processes import SENTENCES, ProcessStatus, _in_slow_time, _Look
from trocar.tools.inspect.standing import first_thing


@dataclass
class SilentPage:
    """A control page that shows an error, and no life."""

    state: str

    def get(self, name: str) -> Any:
        return b"no sensor" if name == "error" else 0


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("lives", [True, False])
@pytest.mark.parametrize("kind", ["supervisor", "arm"])
def test_each_state_of_a_process_has_its_words(state: str, lives: bool, kind: str) -> None:
    page: Any = SilentPage(state)
    problem = _Look(page, Process("force", kind, 0.0), {}, simulated=False, lives=lives).problem()
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
    page: Any = SilentPage("STOPPED")
    row, ledger = Process("force", "user", 0.0, on_exit=on_exit), {"exit_reason": reason, "lifecycle": lifecycle}
    assert _Look(page, row, ledger, simulated=False, lives=False).problem() == problem


@pytest.mark.parametrize("state", ["CREATED", "FAILED", "STOPPED"])
@pytest.mark.parametrize("lifecycle", ["RUNNING", "RESTARTING"])
def test_one_that_the_supervisor_starts_again_has_no_problem(state: str, lifecycle: str) -> None:
    page: Any = SilentPage(state)
    ledger = {"exit_reason": "killed by SIGKILL", "lifecycle": lifecycle}
    assert not _Look(page, Process("force", "user", 0.0), ledger, simulated=False, lives=False).problem()


@pytest.mark.parametrize(("kind", "period_s", "missed", "problem"), [
    ("io", 0.00133, 700, ""),
    ("arm", 0.004, 1250, "runs at 250 Hz instead of 1500: this machine is too slow (trocar doctor)"),
    ("arm", 0.004, 10, ""),  # it rests
    ("user", 0.004, 1250, "")])
def test_on_the_wall_clock_half_of_the_deadlines_is_not_well(
        kind: str, period_s: float, missed: int, problem: str) -> None:
    page = Mock(state="RUNNING", get={"error": b"", "period_avg": period_s, "interval_cycles": round(1 / period_s),
                                       "interval_missed": missed, "heartbeat_ns": 0}.__getitem__)
    look = _Look(page, Process("PSM1", kind, 1 / 1500), {"lifecycle": "RUNNING"}, simulated=False, lives=True)
    assert look.problem() == problem
    assert not dataclasses.replace(look, simulated=True).problem()


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


@pytest.mark.parametrize(("problem", "state", "lifecycle", "lives", "sentence"), [
    ("", "STOPPED", "STOPPED", False, ""),
    ("dead", "DEAD", "STOPPED", False, "nudge is dead (killed by SIGKILL)"),
    ("dead", "DEAD", "RUNNING", False, "nudge is dead"),
    ("not running: killed by SIGKILL", "STOPPED", "STOPPED", False, "nudge is not running: killed by SIGKILL"),
    ("silent: no packets", "RUNNING", "RUNNING", True, "nudge: silent: no packets")])
def test_a_problem_is_a_sentence_with_the_reason_of_this_end_once(
        problem: str, state: str, lifecycle: str, lives: bool, sentence: str) -> None:
    assert ProcessStatus("nudge", "user", state, problem=problem, lifecycle=lifecycle, lives=lives,
                         exit_reason="killed by SIGKILL").said == sentence
