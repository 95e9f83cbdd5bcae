"""docs/faults.md, "What you see, what it means, what to type": every row, tried on emulated faults.

A scenario makes what the row is about, the words of its first column must be seen, hands mend what broke, and what the
last column says is typed: then all is well.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
import yaml

from tests.system.conftest import systems
from tests.system.robot import DEMO, ROOT, Robot, wait_for
from tests.system.robot_in_host import HOSTED

pytestmark = [pytest.mark.slow, pytest.mark.simulated(HOSTED)]
HEADING = "## What you see, what it means, what to type"
Words = tuple[str, ...]
STATUS: Words = ("status",)


@dataclass(frozen=True)
class SightRow:
    """One row of the table: patterns of what is seen (one of them is enough), commands to type."""

    seen: str
    patterns: Words
    typed: tuple[Words, ...]


@dataclass(frozen=True)
class Scenario:
    """What breaks, orders to boards; where it is seen; what mends it."""

    breaks: tuple[str, ...] = ()
    looks: Words = STATUS
    mends: tuple[str, ...] = ()
    before: tuple[Words, ...] = ()


def rows() -> list[SightRow]:
    text = (ROOT / "docs" / "faults.md").read_text(encoding="utf-8")
    section = text.partition(HEADING)[2].partition("\n## ")[0]
    found = []
    for line in section.splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("| `") and len(cells) == 3:
            patterns = [re.escape(code).replace("…", ".*") for code in re.findall(r"`([^`]+)`", cells[0])]
            typed = [tuple(code.split()[1:]) for code in re.findall(r"`(trocar [^`]+)`", cells[2])]
            found.append(SightRow(cells[0], tuple(patterns), tuple(typed)))
    return found


DISABLE, ENABLE, PAUSE = (("send", "PSM1", "state_command", word, "--wait") for word in ("disable", "enable", "pause"))
SCENARIOS = {
    "all well": Scenario(before=(DISABLE,)),
    "an amplifier is off": Scenario(("amp_fault PSM1 2 1",), mends=("amp_fault PSM1 2 0",)),
    "cannot follow its setpoint": Scenario(("encoder_jump PSM1 3 -40000",)),
    "motor power went off": Scenario(("emergency_stop 1",), mends=("emergency_stop 0",)),
    "motor power did not come on": Scenario(("emergency_stop 1",), ("home", "PSM1"), ("emergency_stop 0",),
                                            before=(DISABLE,)),
    "motor supply fault": Scenario(("power_loss PSM1 1",), mends=("power_loss PSM1 0",)),
    "the controller switched an amplifier off": Scenario(("current_error PSM1 3 0.6",),
                                                         mends=("current_error PSM1 3 0",)),
    "potentiometer and encoder disagree": Scenario(("pot_drift PSM1 3 0.5",), mends=("pot_drift PSM1 3 0 0",)),
    "amplifier too hot": Scenario(("temperature 7 66.5 31 IO1",), mends=("temperature 7 31 31 IO1",)),
    "amplifier getting hot": Scenario(("temperature 7 61 31 IO1",), ("logs", "IO1"), ("temperature 7 31 31 IO1",)),
    "has left the bus": Scenario(("unplug_board 7 IO1",), mends=("plug_board 7 IO1",)),
    "instrument not named": Scenario(("insert_instrument PSM1 LARGE_NEEDLE_DRIVER:400006",)),
    "done, clipped": Scenario(looks=("send", "PSM1", "move_jp", "0", "0", "5", "0", "0", "0", "--wait")),
    "done, 17.2° short": Scenario(("jam PSM1 1 1",), ("send", "PSM1", "move_jr", "0", "0.3", "0", "0", "0", "0",
                                                      "--wait"), ("jam PSM1 1 0",)),
    "arm not ready": Scenario(looks=("send", "PSM1", "move_jp", "0", "0", "0.1", "0", "0", "0"), before=(DISABLE,)),
    "it is PAUSED": Scenario(looks=("home", "PSM1"), before=(PAUSE,)),
    "io was restarted": Scenario(),
}
ROWS = {next((key for key in SCENARIOS if key in row.seen), row.seen): row for row in rows()}
APART = ("instrument not named", "io was restarted")


def test_every_row_has_a_scenario_and_every_scenario_a_row() -> None:
    assert set(ROWS) == set(SCENARIOS) and len(ROWS) == len(rows())
    assert all(row.typed for row in ROWS.values())


@pytest.fixture(scope="module")
def homed(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    """The demo's arm, homed; one for all rows, each of which leaves it so."""
    with systems(tmp_path_factory.mktemp("rows"), HOSTED) as make:
        robot = make()
        robot.up()
        robot.trocar("home", timeout=300)
        yield robot


def printed(robot: Robot, words: Words) -> str:
    """All that a command prints, whatever its exit code, in one line."""
    done = robot.types(*words)
    return " ".join(f"{done.stdout} {done.stderr}".split())


def see(robot: Robot, row: SightRow, words: Words) -> None:
    """The command shows what the row says, in the end."""
    shown: list[str] = []

    def is_seen() -> bool:
        shown.append(printed(robot, words))
        return any(re.search(pattern, shown[-1]) for pattern in row.patterns)

    wait_for(is_seen, 60.0, f"{row.seen}: {row.patterns}, seen was: {shown[-1:]}")


def type_it(robot: Robot, row: SightRow) -> None:
    for words in row.typed:
        robot.trocar(*words, timeout=300)
    wait_for(lambda: "all well" in printed(robot, STATUS), 30, "all well")


@pytest.mark.parametrize("key", [key for key in SCENARIOS if key not in APART])
def test_what_is_seen_is_mended_by_what_the_row_says(homed: Robot, key: str) -> None:
    row, scenario = ROWS[key], SCENARIOS[key]
    homed.trocar("home", timeout=300)
    for words in scenario.before:
        homed.trocar(*words)
    for order in scenario.breaks:
        homed.trocar("send", "boards", *order.split())
    see(homed, row, scenario.looks)
    if "short" in key:
        event = json.loads(homed.trocar("echo", "PSM1/goal_reached", "-n", "1", "--json").splitlines()[-1])
        assert event["reached"] is False, event
    for order in scenario.mends:
        homed.trocar("send", "boards", *order.split())
    type_it(homed, row)


def test_the_arms_own_error_has_axis_and_board_as_data(homed: Robot) -> None:
    homed.trocar("home", timeout=300)
    homed.trocar("send", "boards", "amp_fault", "PSM1", "2", "1")
    wait_for(lambda: "FAULT" in printed(homed, STATUS), 60.0, "FAULT")
    event = json.loads(homed.types("echo", "PSM1/error", "-n", "1", "--json").stdout.splitlines()[-1])
    assert (event["code"], event["axis"], event["board"]) == ("amplifier", 2, 6), event
    homed.trocar("send", "boards", "amp_fault", "PSM1", "2", "0")
    homed.trocar("home", timeout=300)


def test_an_instrument_that_nobody_named_is_asked_for(robot: Robot, tmp_path: Path) -> None:
    key, arm = "instrument not named", tmp_path / "PSM1.yaml"
    arm.write_text(yaml.safe_dump({"$id": "dvrk-psm.schema.json", "$version": "1", "kinematic": "kinematic/PSM.yaml",
                                   "generation": "Classic", "tool_detection": "MANUAL"}))
    system = yaml.safe_load(DEMO.read_text())
    system["arms"][0]["arm_file"] = str(arm)
    file = tmp_path / "system.yaml"
    file.write_text(yaml.safe_dump(system))
    robot.up(file)
    robot.trocar("send", "boards", "insert_instrument", *SCENARIOS[key].breaks[0].split()[1:])
    reported = printed(robot, ("home", "--timeout", "15"))
    assert re.search(ROWS[key].patterns[0], reported), reported
    see(robot, ROWS[key], STATUS)
    type_it(robot, ROWS[key])


def test_io_that_died_is_told_and_the_arm_is_homed_again(homed: Robot) -> None:
    robot = homed
    robot.trocar("home", timeout=300)
    old = robot.kill("IO1")
    wait_for(lambda: robot.pid("IO1") != old and robot.state("IO1") == "RUNNING", 60, "io's restart")
    see(robot, ROWS["io was restarted"], STATUS)
    type_it(robot, ROWS["io was restarted"])
