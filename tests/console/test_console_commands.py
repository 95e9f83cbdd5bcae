"""What a console answers."""

from __future__ import annotations

import pytest

from tests.cases import cases
from tests.console.test_logic import ALL, RIGHT, FakeDesk
from tests.io.harness import FakeCommand
from trocar.procs.console.console_commands import LET_GO_NS, ConsoleCommands
from trocar.procs.console.logic import OPERATOR, Logic
from trocar.procs.console.selection import PSM, Selectable
from trocar.procs.node.debounce import PRESSED

OTHER = Selectable("MTMX_PSM1", "d", PSM, ("MTMX", "PSM1"))
MINE = Selectable("MTMX_PSM4", "d", PSM, ("MTMX", "PSM4"))


def asked(commands: ConsoleCommands, name: str, *values: float, text: str = "", now_ns: int = 1) -> FakeCommand:
    command = FakeCommand(name, text, *values)
    commands.execute([command], now_ns)
    return command


def test_commands_reach_the_logic() -> None:
    logic = Logic("c", ALL, FakeDesk(), 0.2)
    commands = ConsoleCommands(logic)
    for name, values in (("teleop_enable", 1.0), ("set_scale", 0.5), ("emulate_operator_present", 1.0),
                         ("emulate_clutch", 1.0), ("emulate_camera", 1.0)):
        assert asked(commands, name, values).outcome == "done"
    assert logic.wanted and logic.operator and logic.clutch and logic.camera and logic.scale == 0.5
    assert asked(commands, "unselect_teleop", text="MTMR_PSM1").outcome == "done"
    assert "MTMR_PSM1" not in logic.selected
    assert asked(commands, "select_teleop", text="MTML_PSM3").outcome == "done" and "MTML_PSM3" in logic.selected


@cases(
    ("name", "values", "text"),
    [("teleop_enable", (2.0,), ""), ("set_scale", (0.0,), ""), ("set_scale", (float("nan"),), ""),
     ("set_scale", (float("inf"),), ""), ("set_scale", (20.0,), ""),
     ("emulate_operator_present", (2.0,), ""), ("emulate_clutch", (), ""),
     ("select_teleop", (), "MTMR_PSM9"), ("unselect_teleop", (), "")],
)
def test_what_makes_no_sense_is_refused(name: str, values: tuple[float, ...], text: str) -> None:
    command = asked(ConsoleCommands(Logic("c", ALL, FakeDesk(), 0.2)), name, *values, text=text)
    assert command.outcome == "refused" and len(command.answers[0][1]) > len(name) + 10


def test_another_scale_is_passed_on_with_whose_command_it_was() -> None:
    desk = FakeDesk()
    command = asked(ConsoleCommands(Logic("c", ALL, desk, 0.2)), "set_scale", 0.5)
    assert desk.origins == [command.origin] * len(ALL) and command.origin.id


def test_a_teleoperation_that_is_started_again_keeps_its_own_scale() -> None:
    desk = FakeDesk()
    logic = Logic("c", ALL, desk, 0.2)
    commands = ConsoleCommands(logic)
    asked(commands, "set_scale", 0.5)
    desk.asks.clear()
    logic.began_anew(RIGHT.name)
    assert not [ask for ask in desk.asks if ask[1] == "set_scale"], "somebody may have given it a smaller one"


def test_an_emulated_operator_goes_with_the_program_that_sent_it() -> None:
    for leave in ({"has_client": False}, {"pid": 4712}):
        desk = FakeDesk()
        logic = Logic("c", ALL, desk, 0.2)
        commands = ConsoleCommands(logic, has_operator_input=False)
        command = asked(commands, "emulate_operator_present", 1.0)
        commands.execute([], 2)
        assert logic.operator and "until this program ends" in command.answers[-1][1]
        vars(command).update(leave)  # somebody else has its place, or nobody
        commands.execute([], 3)
        assert not logic.operator and desk.reported_events[-2:] == [
            ("status", "c: the program that emulated the operator has ended; the operator counts as absent"),
            ("button", "operator_present")]
        commands.execute([], 4)
        assert desk.reported_events[-1] == ("button", "operator_present") and len(desk.beeps) == 2


@pytest.mark.parametrize("has_input", [False, True])
def test_an_emulated_operator_stays_where_nothing_else_shows_one(has_input: bool) -> None:
    logic = Logic("c", ALL, FakeDesk(), 0.2)
    commands = ConsoleCommands(logic, has_operator_input=has_input)
    command = asked(commands, "emulate_operator_present", 1.0, text="stay")
    command.has_client = False
    commands.execute([], 2)
    assert command.outcome == ("refused" if has_input else "done") and logic.operator is not has_input
    assert asked(commands, "emulate_operator_present", 0.0).outcome == "done" and not logic.operator
    assert asked(commands, "emulate_operator_present", 1.0, text="forever").outcome == "refused"


def test_whoever_emulates_the_operator_last_keeps_it_there() -> None:
    logic = Logic("c", ALL, FakeDesk(), 0.2)
    commands = ConsoleCommands(logic, has_operator_input=False)
    first = asked(commands, "emulate_operator_present", 1.0)
    second = asked(commands, "emulate_operator_present", 1.0)
    first.has_client = False
    commands.execute([], 2)
    assert logic.operator
    asked(commands, "emulate_operator_present", 0.0)
    logic.press(OPERATOR, PRESSED)
    second.has_client = False
    commands.execute([], 3)
    assert logic.operator, "a pedal of the console holds it now"


def test_selection_waits_for_the_other_console_a_second() -> None:
    desk = FakeDesk()
    logic = Logic("d", (RIGHT, OTHER), desk, 0.2)
    logic.elsewhere = {RIGHT.name}
    commands = ConsoleCommands(logic)
    command = asked(commands, "select_teleop", text=OTHER.name)
    assert command.outcome == "accepted" and desk.freed == [RIGHT.name]
    commands.execute([], LET_GO_NS)
    assert command.outcome == "accepted"
    commands.execute([], LET_GO_NS + 1)
    assert command.outcome == "failed"
    logic.elsewhere = set()
    logic.step(LET_GO_NS + 2)
    assert logic.selected == set(), "who has been told no is not selected later"


def test_a_second_selection_ends_the_wait_of_the_first_once() -> None:
    logic = Logic("d", (RIGHT, OTHER, MINE), FakeDesk(), 0.2)
    logic.elsewhere = {RIGHT.name}
    commands = ConsoleCommands(logic)
    first = asked(commands, "select_teleop", text=OTHER.name)
    assert asked(commands, "select_teleop", text=MINE.name).outcome == "done"
    assert [answer for answer, _ in first.answers] == ["accepted", "failed"]
    commands.execute([], LET_GO_NS + 2)
    assert asked(commands, "select_teleop", text=MINE.name).outcome == "done"
    assert [answer for answer, _ in first.answers] == ["accepted", "failed"]


def test_a_selection_that_has_waited_is_answered_once() -> None:
    logic = Logic("d", (RIGHT, OTHER), FakeDesk(), 0.2)
    logic.elsewhere = {RIGHT.name}
    commands = ConsoleCommands(logic)
    command = asked(commands, "select_teleop", text=OTHER.name)
    logic.elsewhere = set()
    for now_ns in (2, 3, LET_GO_NS + 2):
        logic.step(now_ns)
        commands.execute([], now_ns)
    assert [answer for answer, _ in command.answers] == ["accepted", "done"]
