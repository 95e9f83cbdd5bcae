"""The table of states, pair by pair, and every state_command in every state on a fake io."""

from __future__ import annotations

import itertools
from typing import cast

import pytest

from tests.arm.fake_io import ArmHarness
from tests.arm.fake_requests import FakeReports, FakeRequest
from tests.cases import cases
from trocar.procs.arm.machine import ArmStates
from trocar.procs.arm.states import (
    ACCEPTED,
    ACCEPTED_ENABLING,
    BEYOND,
    BUSY,
    COMMANDS,
    DESIRES,
    PUBLISHED,
    RESUMES,
    ArmEvent,
    ArmState,
    follow,
    refusal,
)
from trocar.shm.mailbox.received import Request
from trocar.shm.system.events import Events

POWERED = (ArmState.ENABLED, ArmState.CALIBRATING, ArmState.BIASED, ArmState.HOMING, ArmState.HOMED)
# of some arms only
OWN = (ArmState.MANUAL, ArmState.ENGAGING_ADAPTER, ArmState.ENGAGING_TOOL, ArmState.FINDING_ROLL, ArmState.SETTING_ROLL,
       ArmState.OWN)

LEAVE = {ArmEvent.DISABLE: ArmState.DISABLED, ArmEvent.PAUSE: ArmState.PAUSED, ArmEvent.UNHOME: ArmState.ENABLED,
         ArmEvent.PROBLEM: ArmState.FAULT}

# The table once more, as a person reads the specification: rows are states, columns the events that change them.
EXPECTED = {
    ArmState.DISABLED: {ArmEvent.ONWARD: ArmState.POWERING, ArmEvent.PROBLEM: ArmState.FAULT},
    ArmState.POWERING: {ArmEvent.POWERED: ArmState.ENABLED, ArmEvent.DISABLE: ArmState.DISABLED,
                        ArmEvent.PROBLEM: ArmState.FAULT},
    ArmState.ENABLED: {ArmEvent.ONWARD: ArmState.CALIBRATING, ArmEvent.DISABLE: ArmState.DISABLED,
                       ArmEvent.PAUSE: ArmState.PAUSED, ArmEvent.PROBLEM: ArmState.FAULT},
    ArmState.CALIBRATING: {ArmEvent.BIASED: ArmState.BIASED, ArmEvent.DISABLE: ArmState.DISABLED,
                           ArmEvent.PAUSE: ArmState.PAUSED,
                           ArmEvent.UNHOME: ArmState.ENABLED, ArmEvent.PROBLEM: ArmState.FAULT},
    ArmState.BIASED: {ArmEvent.ONWARD: ArmState.HOMING, ArmEvent.ROLL: ArmState.FINDING_ROLL, **LEAVE},
    ArmState.HOMING: {ArmEvent.ARRIVED: ArmState.HOMED, ArmEvent.DISABLE: ArmState.DISABLED,
                      ArmEvent.PAUSE: ArmState.PAUSED,
                      ArmEvent.UNHOME: ArmState.ENABLED, ArmEvent.PROBLEM: ArmState.FAULT},
    ArmState.HOMED: {ArmEvent.PRESSED: ArmState.MANUAL, ArmEvent.ADAPTER: ArmState.ENGAGING_ADAPTER,
                     ArmEvent.TOOL: ArmState.ENGAGING_TOOL, ArmEvent.BEGUN: ArmState.OWN, **LEAVE},
    ArmState.MANUAL: {ArmEvent.RELEASED: ArmState.HOMED, **LEAVE},
    ArmState.ENGAGING_ADAPTER: {ArmEvent.ENGAGED: ArmState.HOMED, **LEAVE},
    ArmState.ENGAGING_TOOL: {ArmEvent.ENGAGED: ArmState.HOMED, **LEAVE},
    ArmState.OWN: {ArmEvent.ENDED: ArmState.HOMED, **LEAVE},
    ArmState.FINDING_ROLL: {ArmEvent.STOPPED: ArmState.SETTING_ROLL, **LEAVE},
    ArmState.SETTING_ROLL: {ArmEvent.SET: ArmState.HOMING, **LEAVE, ArmEvent.PAUSE: ArmState.SETTING_ROLL},
    ArmState.PAUSED: {ArmEvent.RESUME: ArmState.ENABLED, ArmEvent.DISABLE: ArmState.DISABLED,
                      ArmEvent.PROBLEM: ArmState.FAULT},
    ArmState.FAULT: {ArmEvent.DISABLE: ArmState.DISABLED, ArmEvent.ENABLE: ArmState.DISABLED},
}


def test_every_pair_leads_where_the_specification_says() -> None:
    found = {state: {event: follow(state, event) for event in ArmEvent} for state in ArmState}
    assert found == {state: dict.fromkeys(ArmEvent, state) | EXPECTED[state] for state in ArmState}


def test_every_state_is_published_and_every_word_is_known() -> None:
    assert set(PUBLISHED) == set(ArmState) and set(PUBLISHED.values()) == set(ACCEPTED)
    assert {word for words in ACCEPTED.values() for word in words} == set(COMMANDS)
    assert set(DESIRES) == set(COMMANDS) - {ArmEvent.RESUME}
    assert set(RESUMES) == {*POWERED, *OWN} and set(RESUMES.values()) <= set(POWERED) - BUSY
    assert BUSY.isdisjoint(BEYOND)


def test_a_refusal_names_command_state_and_sub_state() -> None:
    for state, word in itertools.product(ArmState, COMMANDS):
        reason = refusal(state, state, word)
        assert (word in ACCEPTED[PUBLISHED[state]]) is (not reason), (state, word)
        assert not reason or all(part in reason for part in (word, PUBLISHED[state], state)), (state, word)


def test_an_unknown_word_is_refused_with_the_known_ones() -> None:
    assert "enable" in (why := refusal(ArmState.HOMED, ArmState.HOMED, "fly")) and "fly" in why


AFTER = {  # where a command leads in the end; not listed: stays
    ("DISABLED", "enable"): "ENABLED",
    ("POWERING", "enable"): "ENABLED",
    ("POWERING", "unhome"): "ENABLED",
    ("POWERING", "home"): "HOMED",
    ("CALIBRATING_ENCODERS_FROM_POTS", "enable"): "ENCODERS_BIASED",
    ("CALIBRATING_ENCODERS_FROM_POTS", "home"): "HOMED",
    ("HOMING", "enable"): "HOMED",
    ("HOMING", "home"): "HOMED",
    ("ENABLED", "home"): "HOMED",
    ("ENCODERS_BIASED", "home"): "HOMED",
    ("PAUSED", "resume"): "HOMED",
    ("FAULT", "enable"): "ENABLED",
}


def accepted_in(state: str) -> tuple[ArmEvent, ...]:
    return ACCEPTED_ENABLING if state == "POWERING" else ACCEPTED[PUBLISHED[ArmState(state)]]


def where_to(state: str, word: str) -> str:
    published = PUBLISHED[ArmState(state)]
    if word not in accepted_in(state):  # nothing changes: an earlier command continues
        return {"POWERING": "ENABLED", "CALIBRATING_ENCODERS_FROM_POTS": "HOMED", "HOMING": "HOMED"}.get(state, state)
    if word == "disable":
        return "DISABLED"
    if word == "pause":
        return "PAUSED"
    if word == "unhome" and published == "ENABLED":
        return "ENABLED"
    return AFTER.get((state, word), state)


COMMON = [str(state) for state in ArmState if state not in OWN]


@cases(("state", "word"), list(itertools.product(COMMON, (*COMMANDS, "fly", ""))))
def test_every_command_in_every_state_is_answered_and_leads_on(state: str, word: str) -> None:
    harness = ArmHarness()
    harness.reach(state)
    harness.reports.events.clear()
    request = harness.state_command(str(word))
    accepted = word in accepted_in(state)
    assert request.outcomes[0] == ("accepted" if accepted else "refused")
    assert len(harness.reports.of("operating_state")) >= (2 if accepted else 1)
    assert len(harness.reports.of("warning")) == (0 if accepted else 1)
    with harness.hurried():
        harness.until(lambda: harness.arm.state == where_to(state, word), 10.0)
        harness.run(1.0)
    assert harness.arm.state == where_to(state, word)
    if accepted:
        assert request.outcomes == ["accepted", "done"]
    else:
        assert len(request.outcomes) == 1 and request.replies[0][1]
    paused = harness.arm.state == "PAUSED" and state in ("HOMED", "PAUSED") and word != "unhome"
    assert bool(harness.state["is_homed"]) is (harness.arm.state == "HOMED" or paused)
    assert not harness.reports.of("error")


HELD = {**{str(state): "PAUSED" for state in POWERED}, "HOMED": "HOMED", "POWERING": "ENABLED"}


@cases("state", COMMON)
def test_hold_is_accepted_in_every_state_and_nothing_moves_after_it(state: str) -> None:
    harness = ArmHarness()
    harness.reach(state)
    assert harness.send("hold").outcomes[-1] == "done"
    harness.run(0.01)
    before = harness.io.position.copy()
    with harness.hurried():
        harness.run(1.0)
    assert harness.arm.state == HELD.get(state, state) and (harness.io.position == before).all()
    assert not harness.reports.of("warning") or state == "FAULT"


@pytest.mark.parametrize("state", [state for state in (*POWERED, *OWN)  # test_roll.py has SETTING_ROLL
                                   if state not in (ArmState.HOMED, ArmState.SETTING_ROLL)])
def test_hold_pauses_whatever_an_arm_does_by_itself(state: ArmState) -> None:
    states = ArmStates("PSM1", cast(Events, FakeReports()), lambda left: None, lambda: False)
    states.place(state)
    request = FakeRequest("hold")
    assert states.hold(cast(Request, request)) and states.state is ArmState.PAUSED
    states.settle(is_power_off=False)
    assert request.outcomes == ["accepted", "done"]


def test_hold_cancels_a_home_that_waits_for_the_power() -> None:
    harness = ArmHarness()
    harness.run(0.1)
    enable, home = harness.state_command("enable"), harness.state_command("home")
    assert harness.arm.state == "POWERING" and home.outcomes == ["accepted"]
    assert harness.send("hold").outcomes == ["done"] and home.replies[-1] == ("failed", "hold was requested")
    with harness.hurried():
        harness.run(2.0)
    assert harness.arm.state == "ENABLED" and enable.outcomes == ["accepted", "done"]


def test_an_accepted_command_without_change_is_answered_twice() -> None:
    harness = ArmHarness().homed()
    harness.state_command("home")
    state = ("operating_state", "ENABLED", "HOMED", True, False)
    assert harness.reports.events == [state, state]


def test_a_second_home_while_homing_is_done_with_the_first() -> None:
    harness = ArmHarness()
    harness.reach("HOMING")
    both = harness.state_command("home"), harness.state_command("home")
    harness.until(lambda: harness.arm.state == "HOMED")
    harness.run(0.1)
    assert [one.outcomes for one in both] == [["accepted", "done"]] * 2


def test_unhome_takes_homing_away_and_home_biases_again() -> None:
    harness = ArmHarness().homed()
    biases = harness.io.flag("bias_generation")
    harness.state_command("unhome")
    assert harness.arm.state == "ENABLED" and not harness.state["is_homed"]
    harness.run(0.2)
    assert not harness.io.flag("pid_enabled") and harness.io.flag("powered")
    harness.state_command("home")
    harness.until(lambda: harness.arm.state == "HOMED")
    assert harness.io.flag("bias_generation") == biases + 1


@pytest.mark.parametrize("state", ("CALIBRATING_ENCODERS_FROM_POTS", "HOMING", "HOMED"))
def test_resume_goes_on_to_what_was_asked_before(state: str) -> None:
    harness = ArmHarness()
    harness.reach(state)
    harness.state_command("pause")
    harness.run(0.5)
    assert harness.arm.state == "PAUSED" and harness.state.text("state") == "PAUSED"
    harness.state_command("resume")
    harness.until(lambda: harness.arm.state == "HOMED")
    harness.run(0.5)
    assert harness.arm.state == "HOMED" and harness.state["is_homed"]


def test_unhome_while_paused_is_not_undone_by_resume() -> None:
    harness = ArmHarness()
    harness.reach("PAUSED")
    harness.state_command("unhome")
    harness.state_command("resume")
    harness.run(0.3)
    assert harness.arm.state == "ENABLED" and not harness.state["is_homed"]


def test_is_homed_is_false_as_soon_as_power_goes() -> None:
    harness = ArmHarness().homed()
    harness.state_command("disable")
    disabled = [e for e in harness.reports.of("operating_state") if e[1] == "DISABLED"]
    assert disabled and not any(homed for *_, homed, _ in disabled)


def test_a_newer_state_command_fails_the_older() -> None:
    harness = ArmHarness()
    harness.run(0.1)
    enable = harness.state_command("enable")
    disable = harness.state_command("disable")
    harness.run(0.1)
    assert enable.outcomes == ["accepted", "failed"] and disable.outcomes == ["accepted", "done"]


def give_in_one_cycle(harness: ArmHarness, *words: str) -> list[FakeRequest]:
    """Run until the arm is in the same state for a second."""
    requests = [FakeRequest("state_command", text=word) for word in words]
    harness.step(*requests)
    with harness.hurried():
        while True:
            before = harness.arm.state
            harness.run(1.0)
            if harness.arm.state == before:
                return requests


@cases(("begin", "words", "end", "outcomes"), [
    ("DISABLED", ("enable", "home"), "HOMED", ("done", "done")),
    ("FAULT", ("enable", "home"), "HOMED", ("done", "done")),
    ("DISABLED", ("enable", "home", "unhome"), "ENABLED", ("failed", "failed", "done")),
    ("DISABLED", ("enable", "home", "disable"), "DISABLED", ("failed", "failed", "done")),
    ("HOMED", ("disable", "enable", "home"), "HOMED", ("failed", "done", "done")),
    ("HOMED", ("disable", "home"), "DISABLED", ("done", "refused")),
    ("HOMED", ("unhome", "home"), "HOMED", ("done", "done")),
    ("HOMED", ("pause", "resume"), "HOMED", ("done", "done")),
])
def test_commands_in_one_cycle_are_carried_out_in_order(begin: str, words: tuple[str, ...], end: str,
                                                        outcomes: tuple[str, ...]) -> None:
    harness = ArmHarness()
    harness.reach(begin)
    requests = give_in_one_cycle(harness, *words)
    assert harness.arm.state == end
    assert tuple(request.outcomes[-1] for request in requests) == outcomes


def test_enable_is_answered_before_the_home_that_follows_it() -> None:
    harness = ArmHarness()
    harness.run(0.1)
    enable, home = FakeRequest("state_command", text="enable"), FakeRequest("state_command", text="home")
    harness.step(enable, home)
    harness.until(lambda: enable.outcomes[-1] == "done")
    assert harness.state.text("state") == "ENABLED" and home.outcomes == ["accepted"]


def test_enable_without_io_is_refused_with_the_reason() -> None:
    harness = ArmHarness()
    harness.io.deaf = True
    harness.run(0.1)
    assert harness.state_command("enable").replies == [("refused", "io does not answer")]
