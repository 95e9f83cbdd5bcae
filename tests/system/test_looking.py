"""`trocar attach` and `trocar scope` in a real terminal, at both sizes, beside one running robot."""

from __future__ import annotations

import csv
import io
import json
import re

import pytest

from tests.system.robot import Robot, wait_for
from tests.system.terminal import terminal
from trocar.shm.system.subscriptions import Subscriptions
from trocar.shm.time.control_page import ControlPage

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
SIZES = ((80, 24), (160, 50))
JOINT = "PSM1/measured_js.position[2]"
FAST = "abs(PSM1/measured_js.velocity[2]) > 0.001"


def wanted_of(robot: Robot, instance: str) -> int:
    page = ControlPage(robot.name, instance)
    try:
        subscriptions = Subscriptions(page)
        subscriptions.look()
        return subscriptions.wanted
    finally:
        page.close()


@pytest.mark.parametrize("size", SIZES)
def test_every_page_of_the_inspector_is_seen(demo: Robot, size: tuple[int, int]) -> None:
    with terminal(demo, size) as screen:
        screen.trocar("attach")
        screen.until("supervisor runs", "IO1", "PSM1", "RUNNING", "q quit")
        screen.type("2")
        screen.until("PSM1/state", "500", "nominal")
        screen.type("3", "/", "valid", "Enter")
        screen.until("IO1/state: record", "valid", "yes")
        screen.type("4")
        screen.until("operating_state", "HOMED")
        screen.type("5")
        screen.until("PSM1", "ENABLED HOMED", "yes")
        screen.type("6")
        shown = screen.until("state_command", "done")
        assert wanted_of(demo, "PSM1") == wanted_of(demo, "IO1") == 0  # looking is no subscription
        assert len(shown.rstrip("\n").splitlines()) <= size[1]
        screen.type("q")
        screen.until("ready>")


def test_the_inspector_bears_a_pause(demo: Robot) -> None:
    with terminal(demo, SIZES[0]) as screen:
        screen.trocar("attach")
        screen.until("supervisor runs", "q quit")
        screen.type("C-z")
        screen.until("Stopped")
        screen.type("fg", "Enter")
        screen.until("supervisor runs", "q quit")
        screen.type("2")
        screen.until("PSM1/state", "500")
        screen.type("q")
        screen.until("ready>")


def test_scope_draws_a_move_in_the_terminal(demo: Robot) -> None:
    with terminal(demo, SIZES[0]) as screen:
        screen.trocar("scope", JOINT, "--when", FAST, "--before", "0.2", "--after", "0.5", "--timeout", "60")
        wait_for(lambda: wanted_of(demo, "PSM1"), 60.0, "scope attached")
        demo.trocar("send", "PSM1", "move_jp", "0", "0", "0.15", "0", "0", "0", "--wait")
        shown = screen.until(f"{JOINT}  rad|m", "▲ 0", "records", "ready>")
        assert "lost" not in shown
        demo.trocar("send", "PSM1", "move_jp", "0", "0", "0.12", "0", "0", "0", "--wait")


def test_scope_keeps_every_record_of_what_is_past(demo: Robot) -> None:
    demo.trocar("send", "PSM1", "move_jp", "0", "0", "0.13", "0", "0", "0", "--wait")
    table = list(csv.reader(io.StringIO(demo.trocar("scope", JOINT, "PSM1/state.sequence", "--before", "0.5", "--csv",
                                                    "-"))))
    numbers = [int(float(row[3])) for row in table[1:]]
    assert len(numbers) >= 100 and numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    demo.trocar("send", "PSM1", "move_jp", "0", "0", "0.12", "0", "0", "0", "--wait")


def test_a_snapshot_of_everything_is_one_document(demo: Robot) -> None:
    found = json.loads(demo.trocar("attach", "--json"))
    assert found["supervisor"] == "RUNNING" and found["values"]["PSM1/state"]["state"] == "ENABLED"
    assert {row["name"] for row in found["processes"]} >= {"supervisor", "IO1", "PSM1", "boards"}
    assert all(row["cpu_percent"] is not None for row in found["processes"])


def test_a_scan_that_finds_no_boards_says_where_emulated_ones_are(demo: Robot) -> None:
    reported = " ".join(demo.trocar("bus", "scan", "udp", code=1).split())
    says = re.search(rf"emulated boards of system {demo.name}: trocar (bus scan [^\s;]+)", reported)
    assert says, reported
    found = demo.trocar(*says[1].split(), "--no-serials", "--json")
    assert {json.loads(line)["board"] for line in found.splitlines()} == {6, 7}
