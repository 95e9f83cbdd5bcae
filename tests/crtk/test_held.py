"""What pages hold down ends with their control."""

from __future__ import annotations

import math
from typing import cast

import pytest

from trocar.procs.crtk.calls import Calls, CommandOwner
from trocar.procs.crtk.held import HeldDown
from trocar.procs.crtk.messages import WrongMessage
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.command_row import ITSELF

KINDS = {"SUJ": "suj", "focus": "focus", "console": "console", "boards": "boards", "PSM1": "arm"}


class FakeCalls:
    """What is sent; nothing gets through while it is stuck."""

    def __init__(self) -> None:
        self.sent: list[tuple[object, ...]] = []
        self.is_stuck = False

    def owner(self, name: str) -> CommandOwner:
        return CommandOwner(KINDS[name], {row.name: row for row in COMMANDS[KINDS[name]]})

    def send(self, number: object, to: str, command: str, values: list[float], text: str) -> None:
        if self.is_stuck:
            raise WrongMessage("no room")
        self.sent.append((to, command, *values, text))

    def replies(self) -> tuple[()]:
        return ()

    def new(self) -> list[tuple[object, ...]]:
        found, self.sent = self.sent, []
        return found


def held() -> tuple[HeldDown, FakeCalls]:
    calls = FakeCalls()
    return HeldDown(cast(Calls, calls)), calls


@pytest.mark.parametrize(("to", "command"), [
    ("SUJ", "set_lift_velocity"), ("focus", "focus_in"), ("focus", "focus_out")])
def test_what_is_held_is_let_go_when_another_page_or_none_has_control(to: str, command: str) -> None:
    down, calls = held()
    for holder in ("", "another"):
        down.note("one", to, command, [1.0], "")
        down.tick("one", False)
        assert calls.new() == []
        calls.is_stuck = True
        down.tick(holder, False)
        calls.is_stuck = False
        down.tick("one", False)
        assert calls.new() == [], "it has control again, and holds it still"
        down.tick(holder, False)
        down.tick(holder, False)
        assert calls.new() == [(to, command, 0.0, "")]


def test_an_emulated_operator_stays_for_who_goes_from_page_to_page_and_goes_with_the_last() -> None:
    down, calls = held()
    down.note("one", "console", "emulate_operator_present", [1.0], "")
    down.note("one", "SUJ", "clutch", [1.0], "PSM2")
    for holder in ("one", "", "two"):
        down.tick(holder, False)
    assert calls.new() == []
    down.tick("", True)
    assert calls.new() == [("console", "emulate_operator_present", 0.0, ""), ("SUJ", "clutch", 0.0, "PSM2")]


def test_what_a_page_has_let_go_itself_is_not_let_go_again() -> None:
    down, calls = held()
    for command, values in (("set_lift_velocity", [1.0]), ("set_lift_velocity", [0.0])):
        down.note("one", "SUJ", command, values, "")
    for command, values in (("pull_tip", [0.0] * 6 + [1.0]), ("release_tip", [])):
        down.note("one", "boards", command, values, "PSM1")
    down.note("one", "PSM1", "servo_jv", [1.0], "")
    down.tick("", True)
    assert calls.new() == []


@pytest.mark.parametrize("values", [[], [7.0], [0.0, 0.0], [math.nan]])
def test_what_is_refused_lets_go_of_nothing(values: list[float]) -> None:
    down, calls = held()
    down.note("one", "console", "emulate_operator_present", [1.0], "")
    down.note("one", "console", "emulate_operator_present", values, "")
    down.tick("", True)
    assert calls.new() == [("console", "emulate_operator_present", 0.0, "")]


def test_a_console_that_ends_lets_go_of_all() -> None:
    down, calls = held()
    down.note("one", "boards", "pull_tip", [0.0] * 6 + [1.0], "PSM1")
    down.note("one", "console", "emulate_operator_present", [1.0], "")
    down.end()
    assert [row[1] for row in calls.new()] == ["release_tip", "emulate_operator_present"]


def test_what_ends_a_held_button_needs_neither_control_nor_an_operator() -> None:
    held = [(kind, row) for kind, rows in COMMANDS.items() for row in rows if row.ended_by]
    assert {kind for kind, _ in held} == {"suj", "focus", "console", "boards"}
    for kind, row in held:
        rows = {each.name: each for each in COMMANDS[kind]}
        ending, values = (row, (0.0,)) if row.ended_by == ITSELF else (rows[row.ended_by], ())
        assert not ending.needs_operator("", values) and not ending.expires("", values)
