"""`trocar start|stop|restart` of one process while the others run, and stopping the whole system at any moment."""

from __future__ import annotations

import json
import random
import signal
import time
from typing import Any

import psutil
import pytest

from tests.system.robot import DEMO, ROOT, Robot, wait_for
from trocar.shm.mailbox.client import Client

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
KINEMATIC = ROOT / "configs" / "systems" / "kinematic.yaml"


def row(robot: Robot, instance: str) -> Any:
    """A process as `trocar status` has it."""
    listed = json.loads(robot.trocar("status", "--json", code=None))["processes"]
    return next(each for each in listed if each["name"] == instance)


def arm_state(robot: Robot) -> str:
    """Of PSM1."""
    return str(json.loads(robot.trocar("echo", "PSM1/operating_state", "--json", "--once"))["state"])


def processes(robot: Robot, instance: str) -> list[int]:
    """All that run for an instance, as the kernel lists them."""
    found = []
    for process in psutil.process_iter(["cmdline"]):
        words = [word for word in process.info["cmdline"] or [] if word]
        if words[-4:] == ["--system", robot.name, "--name", instance]:
            found.append(process.pid)
    return found


def test_one_process_is_stopped_and_started_by_a_person(robot: Robot) -> None:
    robot.up(KINEMATIC)
    first = robot.pid("PSM1")
    assert f"PSM1 runs already (pid {first})" in robot.trocar("start", "PSM1")
    asked = robot.trocar("stop", "io", code=2)
    assert "depends on it: PSM1 (arm)" in asked and "--yes" in asked and robot.state("io") == "RUNNING"
    assert "PSM1: stopped" in robot.trocar("stop", "PSM1", "--yes")
    assert (row(robot, "PSM1")["lifecycle"], row(robot, "PSM1")["state"], processes(robot, "PSM1")) == (
        "STOPPED", "STOPPED", [])
    assert robot.state("io") == "RUNNING", "the others go on"
    assert robot.trocar("status", code=1).rstrip().endswith("first: PSM1 is stopped: trocar start PSM1")
    robot.trocar("stop", "io", "--yes")
    assert "PSM1 needs io, which does not run: trocar start io" in robot.trocar("start", "PSM1", code=1)
    for name in ("io", "PSM1"):
        assert "runs (pid " in robot.trocar("start", name)
    assert row(robot, "PSM1")["lifecycle"] == "RUNNING" and row(robot, "PSM1")["restarts"] == 0
    wait_for(lambda: arm_state(robot) == "DISABLED", 60, "nothing is powered by it")
    before = robot.pid("PSM1")
    robot.trocar("restart", "PSM1", "--yes")
    assert robot.pid("PSM1") != before and len(processes(robot, "PSM1")) == 1
    ended = row(robot, "PSM1")["endings"]
    assert [(each["pid"], each["text"]) for each in ended] == [(first, "stopped"), (before, "stopped")]
    assert "no process PSM9" in robot.trocar("start", "PSM9", code=1)
    assert robot.down() == 0


def test_three_clients_at_random_never_get_two_processes(robot: Robot) -> None:
    robot.up(KINEMATIC)
    chance = random.Random(19)
    clients = [Client(robot.name, "supervisor") for _ in range(3)]
    asked: dict[tuple[int, int], str] = {}
    try:
        end = time.monotonic() + 6.0
        while time.monotonic() < end:
            who = chance.randrange(3)
            number = clients[who].send(chance.choice(("start", "stop", "restart")), (), "PSM1")
            asked[who, number] = ""
            wait = time.monotonic() + chance.choice((0.0, 0.05, 0.3, 1.0))
            while time.monotonic() < wait:
                assert len(processes(robot, "PSM1")) <= 1
            for index, client in enumerate(clients):
                asked.update({(index, reply.id): reply.outcome for reply in client.poll()})
        wait_for(lambda: _all_answered(clients, asked), 60, "an answer to everybody")
    finally:
        for client in clients:
            client.close()
    robot.trocar("start", "PSM1")
    robot.pids.add(robot.pid("PSM1"))
    assert len(processes(robot, "PSM1")) == 1 and row(robot, "PSM1")["restarts"] == 0


def _all_answered(clients: list[Client], asked: dict[tuple[int, int], str]) -> bool:
    for index, client in enumerate(clients):
        asked.update({(index, reply.id): reply.outcome for reply in client.poll()})
    return all(outcome in ("done", "failed", "refused") for outcome in asked.values())


@pytest.mark.parametrize("phase", ["nothing", "memory", *(f"{name} {how}" for name in ("boards", "IO1", "PSM1")
                                                          for how in ("begun", "STARTING")), "PSM1 RUNNING"])
def test_a_system_is_stopped_in_every_phase_of_its_start(robot: Robot, phase: str) -> None:
    robot.up(DEMO, wait=False)
    assert robot.supervisor is not None
    wait_for(lambda: reached(robot, phase), 60, phase)
    robot.supervisor.send_signal(signal.SIGTERM)
    assert robot.supervisor.wait(60) in (0, -signal.SIGTERM), robot.output()
    assert robot.left_over() == [] and not any(processes(robot, name) for name in ("boards", "IO1", "PSM1"))
    assert "was not done" not in robot.output() and "killed" not in robot.output(), "they ended by themselves"


def reached(robot: Robot, phase: str) -> bool:
    """Whether a start has come so far: its interpreter runs, there is memory, a process is there, or shows a state."""
    assert robot.supervisor is not None and robot.supervisor.poll() is None, robot.output()
    name, _, how = phase.partition(" ")
    if not how:
        return name == "nothing" or bool(robot.state("supervisor"))
    return bool(processes(robot, name)) if how == "begun" else robot.state(name) in (how, "RUNNING")
