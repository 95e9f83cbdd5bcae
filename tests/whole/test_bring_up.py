"""Power and homing of all arms on fake arms and a fake clock."""

from __future__ import annotations

import pytest

from trocar.procs.system.bring_up import HOME, POWER_OFF, POWER_ON, BringUp
from trocar.shm.mailbox.origins import Origin

SECOND = 1_000_000_000
PERSON = Origin(77, 0, "trocar home")


class FakeArm:
    """An arm that takes its time; what it is asked for happens so many seconds later."""

    def __init__(self, name: str, state: str = "DISABLED", takes_s: float = 0.5) -> None:
        self.name, self.state, self.takes_s, self.reason = name, state, takes_s, ""
        self.is_homed = self.is_busy = self.is_done = False
        self.is_fresh, self.is_deaf = True, False
        self.refusals: list[str] = []
        self.words: list[str] = []
        self.origins: list[Origin] = []
        self._left_s = 0.0

    def ask(self, word: str, origin: Origin) -> bool:
        if (word == "home" and self.state != "ENABLED") or (word == "enable" and self.state == "FAULT"):
            self.refusals.append(f"{word} while {self.state}")
        self.words.append(word)
        self.origins.append(origin)
        self._left_s, self.is_busy, self.is_done = self.takes_s, True, False
        return True

    def hold(self, origin: Origin) -> bool:
        if self.is_deaf:
            return False
        self.words.append("hold")
        self.origins.append(origin)
        return True

    def pass_time(self, seconds: float) -> None:
        self._left_s -= seconds
        if self.is_busy and self._left_s <= 0.0:
            self.is_busy, self.is_done = False, True
            self.state = {"disable": "DISABLED"}.get(self.words[-1], "ENABLED")
            self.is_homed = self.words[-1] == "home"


def climbed(goal: str, *arms: FakeArm, limit_s: float = 100.0) -> tuple[BringUp, float]:
    bring_up, now = BringUp(goal, arms, SECOND, PERSON), 0.0
    while not bring_up.is_over and now < limit_s:
        bring_up.step(round((1.0 + now) * SECOND))
        for arm in arms:
            arm.pass_time(0.01)
        now += 0.01
    return bring_up, now


def test_home_waits_for_slow_power() -> None:
    slow, quick = FakeArm("PSM1", takes_s=5.0), FakeArm("PSM2", takes_s=0.1)
    bring_up, now = climbed(HOME, slow, quick)
    assert bring_up.problems == "" and slow.words == quick.words == ["enable", "home"]
    assert 10.0 < now < 11.0 and slow.is_homed and quick.is_homed


def test_what_an_arm_refused_before_does_not_count() -> None:
    arm = FakeArm("PSM1")
    arm.refusals.append("enable was requested")
    bring_up, _ = climbed(HOME, arm)
    assert bring_up.problems == ""


def test_every_step_is_on_behalf_of_the_person_who_asked_for_it() -> None:
    arm = FakeArm("PSM1", "FAULT")
    climbed(HOME, arm)
    assert arm.origins == [PERSON] * 3


def test_arms_in_fault_are_disabled_first() -> None:
    arm = FakeArm("PSM1", "FAULT")
    bring_up, _ = climbed(POWER_ON, arm)
    assert bring_up.problems == "" and arm.words == ["disable", "enable"]


def test_what_is_there_already_is_not_asked() -> None:
    arm = FakeArm("PSM1", "ENABLED")
    bring_up, _ = climbed(POWER_ON, arm)
    assert bring_up.is_over and arm.words == []


def test_power_that_does_not_come_is_told_after_seven_seconds() -> None:
    stuck, fine = FakeArm("PSM1", takes_s=50.0), FakeArm("PSM2")
    bring_up, now = climbed(POWER_ON, stuck, fine)
    assert bring_up.problems == "PSM1: not enabled in time; it is DISABLED" and fine.state == "ENABLED"
    assert 7.0 <= now < 7.5


def test_what_an_arm_waits_for_is_told_meanwhile_and_at_the_end() -> None:
    stuck = FakeArm("PSM1", "ENABLED", takes_s=500.0)
    stuck.reason = "instrument not named"
    bring_up = BringUp(HOME, [stuck], SECOND, PERSON)
    bring_up.step(SECOND)
    assert bring_up.waiting == "waiting for PSM1 (ENABLED: instrument not named)"
    bring_up.step(100 * SECOND)
    assert bring_up.problems == "PSM1: not homed in time; it waits: instrument not named"


def test_an_arm_that_went_to_fault_tells_why() -> None:
    broken = FakeArm("PSM1")
    bring_up = BringUp(POWER_ON, [broken], SECOND, PERSON)
    bring_up.step(SECOND)
    broken.state, broken.reason = "FAULT", "PSM1 axis 2 (insertion), board 6: off"
    bring_up.step(2 * SECOND)
    assert bring_up.problems == "PSM1: went to FAULT: PSM1 axis 2 (insertion), board 6: off"


def test_silent_arm_is_told_and_others_go_on() -> None:
    silent, fine = FakeArm("PSM1"), FakeArm("PSM2")
    silent.is_fresh = False
    bring_up, _ = climbed(HOME, silent, fine)
    assert bring_up.problems == "PSM1: not homed in time; it does not answer" and fine.is_homed


def test_refusal_is_told_as_it_is() -> None:
    arm = FakeArm("PSM1", "ENABLED")
    arm.ask = lambda word, origin: arm.refusals.append("PSM1: its instrument is stuck") or True  # type: ignore[method-assign]
    bring_up, _ = climbed(HOME, arm)
    assert bring_up.problems == "PSM1: its instrument is stuck"


def test_an_arm_that_goes_to_fault_while_it_homes_is_left_there() -> None:
    arm = FakeArm("PSM1", "ENABLED")
    bring_up = BringUp(HOME, [arm], SECOND, PERSON)
    bring_up.step(SECOND)
    arm.state, arm.reason = "FAULT", "tracking error"
    bring_up.step(2 * SECOND)
    assert bring_up.problems == "PSM1: went to FAULT: tracking error" and arm.words == ["home"]


def test_an_arm_that_another_program_disables_while_it_homes_is_not_enabled_again() -> None:
    arm = FakeArm("PSM1", "ENABLED")
    bring_up = BringUp(HOME, [arm], SECOND, PERSON)
    bring_up.step(SECOND)
    arm.state = "DISABLED"
    bring_up.step(2 * SECOND)
    assert arm.words == ["home"]


@pytest.mark.parametrize("goal", [POWER_ON, HOME])
def test_a_paused_arm_is_told_at_once_with_what_it_needs(goal: str) -> None:
    arm = FakeArm("PSM1", "PAUSED")
    bring_up = BringUp(goal, [arm], SECOND, PERSON)
    bring_up.step(SECOND)
    assert bring_up.problems == "PSM1: it is PAUSED; first: trocar send PSM1 state_command resume" and not arm.words


def test_a_silent_arm_is_disabled_all_the_same() -> None:
    arm = FakeArm("PSM1", "ENABLED")
    arm.is_fresh = False
    bring_up = BringUp(POWER_OFF, [arm], SECOND, PERSON)
    bring_up.step(SECOND)
    assert arm.words == ["disable"]
    bring_up.step(9 * SECOND)
    assert bring_up.problems == "PSM1: not disabled in time; it does not answer"


def test_an_arm_is_off_when_it_has_confirmed_it() -> None:
    arm = FakeArm("PSM1", "ENABLED")
    bring_up = BringUp(POWER_OFF, [arm], SECOND, PERSON)
    bring_up.step(SECOND)
    arm.state, arm.is_busy = "DISABLED", False
    bring_up.step(2 * SECOND)
    assert not bring_up.is_over
    bring_up.step(9 * SECOND)
    assert bring_up.problems == "PSM1: not disabled in time; it has not confirmed that its power is off"


@pytest.mark.parametrize("state", ["ENABLED", "FAULT", "DISABLED"])
def test_power_off_disables_every_arm(state: str) -> None:
    arm = FakeArm("PSM1", state)
    bring_up, _ = climbed(POWER_OFF, arm)
    assert bring_up.problems == "" and arm.words == ["disable"] and arm.state == "DISABLED"


def test_waiting_names_who_is_missing() -> None:
    bring_up = BringUp(POWER_ON, [FakeArm("PSM1"), FakeArm("PSM2", "ENABLED")], SECOND, PERSON)
    bring_up.step(SECOND)
    assert bring_up.waiting == "waiting for PSM1 (DISABLED)"
