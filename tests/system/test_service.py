"""The system as a service: what systemd hears of its start and its end, and what the unit runs after a death."""

from __future__ import annotations

import shlex
import signal
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.system.robot import ROOT, Robot, wait_for

pytestmark = [pytest.mark.slow, pytest.mark.simulated("paced")]
UNIT = (ROOT / "tools/trocar.service").read_text(encoding="utf-8")
PATIENCE_S = 60.0


@pytest.fixture
def heard(robot: Robot, tmp_path: Path) -> Iterator[socket.socket]:
    """The socket that systemd listens at."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as systemd:
        systemd.bind(str(tmp_path / "notify"))
        systemd.settimeout(PATIENCE_S)
        robot.environment |= {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "5000000"}
        yield systemd


def until(heard: socket.socket, line: str) -> list[str]:
    """What it hears up to this line, which has to come."""
    found: list[str] = []
    while not any(line in said.split("\n") for said in found):
        found.append(heard.recv(4096).decode())
    return found


def command(of: str) -> list[str]:
    """The words behind `trocar` that the unit runs."""
    (line,) = [line.removeprefix(f"{of}=").removeprefix("-") for line in UNIT.splitlines() if line.startswith(f"{of}=")]
    python, *module, verb = shlex.split(line)[:4]
    assert python.endswith("/.venv/bin/python") and module == ["-m", "trocar"]
    return [verb, *shlex.split(line)[4:]]


def test_a_service_is_ready_when_its_robot_is_up_lives_and_stops(robot: Robot, heard: socket.socket) -> None:
    verb, file, *options = command("ExecStart")
    assert verb == "up"
    robot.up(ROOT / file.removeprefix("/opt/trocar/"), *options, wait=False)
    until(heard, "READY=1")
    wait_for(robot.is_up, PATIENCE_S, "it is up, as it said")
    until(heard, "WATCHDOG=1")
    assert robot.supervisor is not None
    robot.supervisor.send_signal(signal.SIGTERM)
    until(heard, "STOPPING=1")
    assert robot.supervisor.wait(timeout=PATIENCE_S) == 0 and not robot.left_over()


def test_after_a_death_of_the_supervisor_the_unit_leaves_nothing(robot: Robot, heard: socket.socket) -> None:
    robot.up(ROOT / "configs/systems/kinematic.yaml")
    until(heard, "READY=1")
    robot.kill("supervisor")
    assert robot.supervisor is not None and robot.supervisor.wait(timeout=PATIENCE_S) == -signal.SIGKILL
    for words in (("start", "PSM1"), ("home",), ("send", "PSM1", "move_jp", *"000000")):
        wait_for(lambda words=words: is_named(robot, *words), PATIENCE_S, "what helps")  # type: ignore[misc]
    robot.trocar(*command("ExecStopPost"))
    wait_for(lambda: not robot.left_over(), PATIENCE_S, "processes and memory are gone")


def is_named(robot: Robot, *words: str) -> bool:
    done = robot.types(*words)
    return "trocar up FILE" in done.stdout + done.stderr
