"""`trocar logs --commands`: who was asked for what, by whom, and what became of it."""

from __future__ import annotations

import json
import math
import os
import time
from collections.abc import Iterator

import pytest
from typer.testing import CliRunner

from tests.conftest import World
from trocar.shm.commands import COMMANDS
from trocar.shm.mailbox.audit import Audit
from trocar.shm.mailbox.client import Client, LoopClient
from trocar.shm.mailbox.generations import NoFaults
from trocar.shm.mailbox.mailbox import Mailbox
from trocar.shm.mailbox.mailbox_map import create_mailbox
from trocar.shm.mailbox.origins import Origin
from trocar.shm.system.directory import create_ring, topic_of, writer
from trocar.tools import cli
from trocar.tools.inspect.messages import asked_line, asked_rows
from trocar.tools.output.errors import Problem


@pytest.fixture
def system(world: World) -> Iterator[str]:
    for name in ("PSM1", "ECM"):
        create_mailbox(world.name, name, "arm", COMMANDS["arm"])
        create_ring(world.name, name, topic_of("arm", "audit"), {}, {"kind": "arm"})
    yield world.name
    world.remove()


def asked(system: str, name: str, client: Client) -> None:
    ring = writer(system, name, "audit", "arm")
    owner = Mailbox(system, name, COMMANDS["arm"], guard=NoFaults(), audit=Audit(ring, time.monotonic_ns))
    client.send("state_command", (), "home")
    for command in owner.drain():
        command.accept()
        command.done("HOMED")
    for part in (client, owner, ring):
        part.close()


def test_commands_of_all_processes_come_in_order_with_whose_they_are(system: str) -> None:
    loop = LoopClient(system, "PSM1", "system")
    loop.on_behalf(Origin(0x4D2, 3, "trocar home"))
    asked(system, "PSM1", loop)
    asked(system, "ECM", LoopClient(system, "ECM", "console"))
    reported = [asked_line(row).split("  ", 1)[1] for row in asked_rows(system, None, 20)[0]]
    pid = f"(pid {os.getpid()})"
    assert reported == [
        f"PSM1: state_command home: accepted; for trocar home, number 4d2, generation 3 by system {pid}",
        f"PSM1: state_command home: done (HOMED); for trocar home, number 4d2, generation 3 by system {pid}",
        "ECM: state_command home: refused (state_command: not authorized: needs an operator's command given after the "
        f"last fault, power-off or hold); without an operator's command by console {pid}"]
    assert [row["process"] for row in asked_rows(system, "ECM", 20)[0]] == ["ECM"]


def test_a_process_that_is_not_there_is_named(system: str) -> None:
    with pytest.raises(Problem, match="PSM9: there is no such process"):
        asked_rows(system, "PSM9", 20)


def test_the_newest_of_all_are_shown_and_the_rest_counted(system: str) -> None:
    for _ in range(3):
        asked(system, "PSM1", Client(system, "PSM1"))
    asked(system, "ECM", Client(system, "ECM"))
    rows, older = asked_rows(system, None, 3)
    assert [row["process"] for row in rows] == ["PSM1", "ECM", "ECM"] and older == 5
    result = CliRunner().invoke(cli.build("logs"), ["logs", "--commands", "-n", "3", "--system", system])
    assert result.stdout.splitlines()[0] == "… 5 older commands: -n 30"


def test_the_commands_of_a_system_that_is_down_are_not_silently_none(world: World) -> None:
    with pytest.raises(Problem, match="is down: commands are available while the system is up"):
        asked_rows(world.name, None, 20)


def test_streams_of_an_arm_and_its_jaw_side_by_side_are_told_once_each(system: str) -> None:
    ring = writer(system, "PSM1", "audit", "arm")
    owner = Mailbox(system, "PSM1", COMMANDS["arm"], guard=NoFaults(), audit=Audit(ring, time.monotonic_ns))
    person = Client(system, "PSM1")
    for word in ("servo_jp", "jaw/servo_jp", "servo_jp", "jaw/servo_jp", "hold", "servo_jp", "jaw/servo_jp"):
        person.send(word, (0.1,) * (6 if word == "servo_jp" else word == "jaw/servo_jp"))
        for command in owner.drain():
            command.done("")
    assert [row["command"] for row in asked_rows(system, None, 20)[0]] == [
        "servo_jp", "jaw/servo_jp", "hold", "servo_jp", "jaw/servo_jp"]
    for part in (person, owner, ring):
        part.close()


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
def test_numbers_that_are_none_hide_nothing_that_came_after(system: str, number: float) -> None:
    ring = writer(system, "PSM1", "audit", "arm")
    owner = Mailbox(system, "PSM1", COMMANDS["arm"], guard=NoFaults(), audit=Audit(ring, time.monotonic_ns))
    person = Client(system, "PSM1")
    for values in ((number, 0.5), (0.1, 0.2)):
        person.send("servo_jp", values)
        for command in owner.drain():
            command.refuse(f"it has {values[0]}")
    shown = [CliRunner().invoke(cli.build("logs"), ["logs", "--commands", *more, "--system", system])
             for more in ((), ("--json",))]
    assert [result.exit_code for result in shown] == [0, 0], [result.exception for result in shown]
    first, second = shown[0].stdout.splitlines()
    assert "servo_jp – 0.5: refused" in first and "servo_jp 0.1 0.2: refused" in second
    assert [json.loads(line)["values"] for line in shown[1].stdout.splitlines()] == [[None, 0.5], [0.1, 0.2]]
    for part in (person, owner, ring):
        part.close()
