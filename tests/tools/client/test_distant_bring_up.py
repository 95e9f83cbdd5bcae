"""Arms brought to a state through a bridge: the rule is that of the robot's own machine."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest

from tests.tools.client.test_connection import Says
from tests.tools.client.test_connection import bridge as bridge  # a fixture
from trocar.procs.tables.bring_up import DISABLED, ENABLED, HOMED
from trocar.tools.client.connection import BridgeConnection
from trocar.tools.client.distant import DistantWays
from trocar.tools.output.errors import Problem

Connects = Callable[[Says], BridgeConnection]
GOES_TO = {"disable": "DISABLED", "enable": "ENABLED", "home": "ENABLED"}


@dataclass
class DistantArm:
    """An arm behind a bridge; `then`: the state after a word, if another one than asked for."""

    state: str
    is_homed: bool = False
    age_s: float = 0.0
    ages_s: list[float | None] = field(default_factory=list)
    """Those of the first records."""
    reason: str = ""
    engages: int = 0
    """So many records after `home` show it homed."""
    then: dict[str, str] = field(default_factory=dict)
    words: list[str] = field(default_factory=list)

    def says(self, asked: dict[str, Any]) -> bytes:
        if asked["op"] == "read":
            self.engages -= "home" in self.words
            shown = {"op": "answer", "state": self.state, "sub_state": self.state, "reason": self.reason,
                     "is_homed": self.is_homed or ("home" in self.words and self.engages < 0), "is_busy": False,
                     "stamp_ns": 1, "age_s": self.ages_s.pop(0) if self.ages_s else self.age_s}
            return json.dumps(shown | {"id": asked["id"]}).encode() + b"\n"
        self.words.append(word := str(asked["text"]))
        self.state = self.then.get(word, GOES_TO[word])
        return json.dumps({"op": "reply", "id": asked["id"], "outcome": "done", "text": ""}).encode() + b"\n"


def brought(bridge: Connects, arm: DistantArm, goal: str, timeout: float = 20.0) -> str:
    """Why it is not there; empty: it is."""
    try:
        DistantWays(bridge(arm.says)).bring("PSM1", goal, timeout)
    except Problem as problem:
        return str(problem)
    return ""


@pytest.mark.parametrize(("state", "goal", "words"), [
    ("FAULT", HOMED, ["disable", "enable", "home"]), ("DISABLED", ENABLED, ["enable"]), ("ENABLED", ENABLED, []),
    ("ENABLED", HOMED, ["home"]), ("DISABLED", DISABLED, ["disable"]), ("PAUSED", DISABLED, ["disable"])])
def test_each_word_is_sent_once_and_in_order(bridge: Connects, state: str, goal: str, words: list[str]) -> None:
    arm = DistantArm(state)
    assert brought(bridge, arm, goal) == "" and arm.words == words


def test_an_arm_that_is_homed_is_asked_for_nothing(bridge: Connects) -> None:
    arm = DistantArm("ENABLED", is_homed=True)
    assert brought(bridge, arm, HOMED) == "" and arm.words == []


@pytest.mark.parametrize("goal", [ENABLED, HOMED])
def test_a_paused_arm_is_told_with_what_it_needs(bridge: Connects, goal: str) -> None:
    arm = DistantArm("PAUSED")
    assert brought(bridge, arm, goal) == "PSM1: it is PAUSED; first: trocar send PSM1 state_command resume"
    assert arm.words == []


def test_nothing_is_sent_to_an_arm_that_went_to_fault_on_the_way(bridge: Connects) -> None:
    arm = DistantArm("DISABLED", reason="the supply is off", then={"enable": "FAULT"})
    assert brought(bridge, arm, HOMED) == "PSM1: went to FAULT: the supply is off" and arm.words == ["enable"]


def test_an_arm_that_is_disabled_on_the_way_is_not_enabled_again(bridge: Connects) -> None:
    arm = DistantArm("ENABLED", then={"home": "DISABLED"})
    assert brought(bridge, arm, HOMED, 0.05) == "PSM1: not homed in time; it is DISABLED" and arm.words == ["home"]


def test_home_waits_until_the_instrument_is_engaged(bridge: Connects) -> None:
    arm = DistantArm("ENABLED", engages=5)
    assert brought(bridge, arm, HOMED) == "" and arm.engages < 0
    arm = DistantArm("ENABLED", engages=10**9, reason="instrument not named")
    assert brought(bridge, arm, HOMED, 0.05) == "PSM1: not homed in time; it waits: instrument not named"


def test_an_arm_whose_record_is_old_is_disabled_all_the_same(bridge: Connects) -> None:
    arm = DistantArm("ENABLED", age_s=60.0)
    assert brought(bridge, arm, DISABLED) == "" and arm.words == ["disable"]


@pytest.mark.parametrize("age_s", [60.0, None])
def test_an_old_record_on_the_way_is_waited_for(bridge: Connects, age_s: float | None) -> None:
    arm = DistantArm("ENABLED", ages_s=[age_s, 0.0])
    assert brought(bridge, arm, HOMED) == "" and arm.words == ["home"]
    arm = DistantArm("ENABLED", age_s=60.0)
    assert brought(bridge, arm, HOMED, 0.05) == "PSM1: not homed in time; it has not shown its state"
    assert arm.words == []


def test_a_timeout_of_none_is_the_usual_one(bridge: Connects) -> None:
    assert brought(bridge, DistantArm("ENABLED"), DISABLED, 0.0) == ""
