"""Why something failed or is not valid: shown whole, with its remedy, however little room it had on its way."""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator

import pytest
from typer.testing import CliRunner

from tests.conftest import World
from tests.tools.robot import ScriptedRobot, robot
from trocar.procs.tables import codes
from trocar.shm.memory.layout import shorten
from trocar.tools import cli

APP = cli.build()
REMEDY = codes.TRACKING.remedy_for("PSM1")


@pytest.fixture
def played(world: World) -> Iterator[ScriptedRobot]:
    with robot(world.name) as made:
        yield made


def test_an_answer_that_had_too_little_room_comes_with_its_remedy(played: ScriptedRobot) -> None:
    text = f"PSM1 axis 2 (insertion), board 6: cannot follow its setpoint ({'measured ' * 12}0.06 m, allowed 0.05 m)"
    played.events.report(codes.TRACKING, text, "PSM1", 2)
    stop = threading.Event()

    def arm() -> None:
        while not stop.wait(0.001):
            for command in played.mailbox.drain():
                command.fail(f"{text}; {REMEDY}")

    thread = threading.Thread(target=arm)
    thread.start()
    try:
        done = CliRunner().invoke(APP, ["send", "PSM1", "state_command", "home", "--wait", "--system", played.name])
    finally:
        stop.set()
        thread.join()
    assert done.exit_code == 1 and done.stderr.endswith(f"0.05 m); {REMEDY}\n"), done.stderr


def test_status_shows_the_whole_of_a_reason_that_had_too_little_room(played: ScriptedRobot) -> None:
    text = f"PSM1: {'far ' * 40}off"
    played.events.report(codes.TRACKING, text, "PSM1", 2)
    played.arm.field("reason")[...] = shorten(f"{text}; {REMEDY}", 200)
    played.show_arm(state="FAULT")
    shown = CliRunner().invoke(APP, ["status", "--json", "--system", played.name]).stdout
    assert json.loads(shown)["standings"][0]["reason"] == f"{text}; {REMEDY}"


def test_values_that_are_not_valid_are_shown_with_what_they_need(played: ScriptedRobot) -> None:
    played.arm.field("reason")[...] = b"brakes to release"
    for valid, needed in ((True, ""), (False, "powered, biased, fresh")):
        played.show_arm(state="ENABLED", valid=valid)
        shown = CliRunner().invoke(APP, ["echo", "PSM1/measured_cp", "--once", "--system", played.name]).stdout
        assert ("PSM1 is ENABLED; brakes to release" in " ".join(shown.split())) == (not valid) and needed in shown
