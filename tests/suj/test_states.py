"""States of setup joints: every word in every state, and what is answered."""

from __future__ import annotations

import pytest

from tests.cases import cases
from tests.io.harness import FakeCommand
from tests.suj.harness import FakeSetupReports
from trocar.procs.node.fault_report import NO_FAULT, FaultReport
from trocar.procs.suj.machine import SetupPower, SetupState, SetupStates
from trocar.procs.tables.codes import POWER_LOST


class FakePower(SetupPower):
    """Comes when the test says so."""

    def __init__(self) -> None:
        self.log: list[str] = []
        self.there, self.wrong = False, NO_FAULT

    def on(self, now_ns: int) -> None:
        self.log.append("on")

    def off(self) -> None:
        self.log.append("off")

    def is_on(self) -> bool:
        return self.there

    def problem(self, now_ns: int, *, powering: bool) -> FaultReport:
        return self.wrong


class StatesBench:
    """A machine in a state."""

    def __init__(self, state: SetupState) -> None:
        self.reports, self.power = FakeSetupReports(), FakePower()
        self.machine = SetupStates("SUJ", self.reports, self.power, lambda state: None)
        self.machine.begin(state, False, 0)
        self.reports.states.clear()

    def say(self, word: str) -> FakeCommand:
        request = FakeCommand("state_command", word)
        self.machine.command(request, 0)
        return request


AFTER = {
    (SetupState.DISABLED, "enable"): SetupState.POWERING, (SetupState.DISABLED, "home"): SetupState.POWERING,
    (SetupState.DISABLED, "disable"): SetupState.DISABLED, (SetupState.DISABLED, "unhome"): SetupState.DISABLED,
    (SetupState.POWERING, "enable"): SetupState.POWERING, (SetupState.POWERING, "home"): SetupState.POWERING,
    (SetupState.POWERING, "disable"): SetupState.DISABLED, (SetupState.POWERING, "unhome"): SetupState.POWERING,
    (SetupState.ENABLED, "enable"): SetupState.ENABLED, (SetupState.ENABLED, "home"): SetupState.ENABLED,
    (SetupState.ENABLED, "disable"): SetupState.DISABLED, (SetupState.ENABLED, "unhome"): SetupState.ENABLED,
    (SetupState.FAULT, "enable"): SetupState.POWERING, (SetupState.FAULT, "home"): SetupState.POWERING,
    (SetupState.FAULT, "disable"): SetupState.DISABLED, (SetupState.FAULT, "unhome"): SetupState.FAULT,
}


@cases(("state", "word"), AFTER)
def test_every_word_leads_where_it_should(state: SetupState, word: str) -> None:
    bench = StatesBench(state)
    request = bench.say(word)
    assert bench.machine.state is AFTER[state, word]
    assert len(bench.reports.states) >= 2, "the operating state is reported before and after, even if nothing changes"
    waits = bench.machine.state is SetupState.POWERING
    assert request.outcome == ("accepted" if waits else "done")


@cases("state", SetupState)
@cases("word", ["pause", "resume", "", "Enable", "fly"])
def test_other_words_are_refused_with_a_reason(state: SetupState, word: str) -> None:
    bench = StatesBench(state)
    request = bench.say(word)
    assert request.outcome == "refused" and bench.machine.state is state
    assert bench.reports.of("warning") and request.answers[0][1]


def test_power_comes_and_home_makes_it_homed() -> None:
    bench = StatesBench(SetupState.DISABLED)
    request = bench.say("home")
    assert (bench.machine.published, bench.machine.is_busy, bench.machine.is_homed) == ("DISABLED", True, False)
    assert bench.power.log == ["on"]
    bench.power.there = True
    bench.machine.step(1)
    assert (bench.machine.state, bench.machine.is_homed, request.outcome) == (SetupState.ENABLED, True, "done")
    bench.say("unhome")
    assert (bench.machine.state, bench.machine.is_homed) == (SetupState.ENABLED, False)
    bench.say("disable")
    assert bench.power.log[-1] == "off" and not bench.machine.is_homed


@pytest.mark.parametrize("state", [SetupState.POWERING, SetupState.ENABLED])
def test_trouble_is_a_fault_with_its_reason(state: SetupState) -> None:
    bench = StatesBench(SetupState.DISABLED)
    request = bench.say("enable")
    if state is SetupState.ENABLED:
        bench.power.there = True
        bench.machine.step(1)
    bench.power.wrong = FaultReport(POWER_LOST, "SUJ, board 12: motor power went off", 1, 12, 3.0, 4.0)
    bench.machine.step(2)
    assert bench.machine.state is SetupState.FAULT and bench.power.log[-1] == "off"
    assert bench.reports.of("error") == [bench.machine.waits] == ["SUJ, board 12: motor power went off"]
    assert bench.reports.faults == [("power-lost", 1, 12, 3.0, 4.0)]
    assert request.outcome == ("failed" if state is SetupState.POWERING else "done")
    bench.power.wrong = NO_FAULT
    bench.say("enable")
    assert bench.machine.state is SetupState.ENABLED if bench.power.there else SetupState.POWERING


def test_a_newer_word_answers_the_one_under_way() -> None:
    bench = StatesBench(SetupState.DISABLED)
    request = bench.say("enable")
    bench.say("disable")
    assert request.answers[-1] == ("failed", "disable was requested")


def test_setup_joints_that_were_never_restarted_are_switched_off_as_well() -> None:
    power = FakePower()
    machine = SetupStates("SUJ", FakeSetupReports(), power, lambda state: None)
    for word in ("enable", "disable"):
        machine.command(FakeCommand("state_command", word), 0)
    assert power.log == ["on", "off"]


@pytest.mark.parametrize("state", SetupState)
def test_disable_ends_what_was_desired(state: SetupState) -> None:
    bench = StatesBench(state)
    bench.say("disable")
    bench.machine.step(1)
    assert bench.machine.desired is SetupState.DISABLED and not bench.machine.is_busy


def test_every_change_is_published() -> None:
    bench = StatesBench(SetupState.DISABLED)
    bench.say("home")
    bench.reports.states.clear()
    bench.power.there = True
    bench.machine.step(1)
    assert [row[:2] for row in bench.reports.states if row[0] == "ENABLED"], bench.reports.states
    bench.reports.states.clear()
    bench.machine.fault(FaultReport(POWER_LOST, "a test"))
    assert [row[0] for row in bench.reports.states] == ["FAULT"]


@pytest.mark.parametrize(("state", "desired"), [(SetupState.POWERING, SetupState.ENABLED), *(
    (state, state) for state in (SetupState.DISABLED, SetupState.ENABLED, SetupState.FAULT))])
def test_who_begins_in_a_state_desires_to_stay_or_to_come_through(state: SetupState, desired: SetupState) -> None:
    assert StatesBench(state).machine.desired is desired


def test_setup_joints_begin_with_nothing_to_wait_for() -> None:
    machine = SetupStates("SUJ", FakeSetupReports(), SetupPower(), lambda state: None)
    assert (machine.state, machine.desired, machine.reason, machine.waits) == (SetupState.DISABLED,) * 2 + ("", "")
    assert not machine.is_homed and not machine.is_busy
    machine.begin(SetupState.FAULT, False, 0)
    assert machine.waits == ""
