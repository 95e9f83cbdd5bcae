"""The system as a service: what systemd hears of its start and its end, and what the unit runs after a death."""

from __future__ import annotations

import contextlib
import shlex
import signal
import socket
from collections.abc import Iterator
from pathlib import Path

import psutil
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
    while not any(line in each.split("\n") for each in found):
        found.append(heard.recv(4096).decode())
    return found


def command(of: str) -> list[str]:
    """The words behind `trocar` that the unit runs."""
    (line,) = [line.removeprefix(f"{of}=").removeprefix("-") for line in UNIT.splitlines() if line.startswith(f"{of}=")]
    program, *words = shlex.split(line)
    assert program.endswith("/bin/trocar")
    return words


def test_a_service_is_ready_when_its_robot_is_up_lives_and_stops(robot: Robot, heard: socket.socket) -> None:
    verb, file, *options = command("ExecStart")
    assert verb == "up"
    robot.up(ROOT / "configs/systems" / file, *options, wait=False)
    until(heard, "READY=1")
    wait_for(robot.is_up, PATIENCE_S, "it is up, as it said")
    until(heard, "WATCHDOG=1")
    assert robot.supervisor is not None
    robot.supervisor.send_signal(signal.SIGTERM)
    until(heard, "STOPPING=1")
    assert robot.supervisor.wait(timeout=PATIENCE_S) == 0 and not robot.left_over()
    assert "no system" in said(robot, *command("ExecStopPost")), "systemd runs it then as well; it finds nothing to do"


def test_a_service_that_cannot_start_fails_without_being_ready(robot: Robot, heard: socket.socket) -> None:
    assert robot.types("up", "nowhere.yaml").returncode == 1
    assert not any("READY=1" in line for line in so_far(heard))


def test_a_supervisor_that_hangs_is_silent_and_when_systemd_has_aborted_it_the_unit_leaves_nothing(
        robot: Robot, heard: socket.socket) -> None:
    robot.up(ROOT / "configs/systems/kinematic.yaml", "--set", "supervisor_lost_s=0.2")
    until(heard, "WATCHDOG=1")
    assert robot.supervisor is not None
    robot.supervisor.send_signal(signal.SIGSTOP)
    so_far(heard)
    others = [psutil.Process(pid) for pid in robot.pids - {robot.supervisor.pid}]
    wait_for(lambda: all(has_ended(other) for other in others), PATIENCE_S, "the processes end by themselves")
    assert so_far(heard) == [], "the watchdog is not reset"
    for number in (signal.SIGABRT, signal.SIGCONT):  # WatchdogSignal; a hung process gets it at once
        robot.supervisor.send_signal(number)
    assert robot.supervisor.wait(timeout=PATIENCE_S) == -signal.SIGABRT
    for words in (("start", "PSM1"), ("home",), ("send", "PSM1", "move_jp", *"000000")):
        wait_for(lambda words=words: is_named(robot, *words), PATIENCE_S, "what helps")  # type: ignore[misc]
    robot.trocar(*command("ExecStopPost"))
    wait_for(lambda: not robot.left_over(), PATIENCE_S, "processes and memory are gone")


def is_named(robot: Robot, *words: str) -> bool:
    return "trocar up FILE" in said(robot, *words)


def said(robot: Robot, *words: str) -> str:
    done = robot.types(*words)
    return done.stdout + done.stderr


def so_far(heard: socket.socket) -> list[str]:
    """What systemd has heard since it last listened."""
    found: list[str] = []
    heard.setblocking(False)
    with contextlib.suppress(BlockingIOError):
        while True:
            found.append(heard.recv(4096).decode())
    heard.settimeout(PATIENCE_S)
    return found


def has_ended(process: psutil.Process) -> bool:
    """True also before its exit code has been read."""
    return not process.is_running() or process.status() == psutil.STATUS_ZOMBIE
