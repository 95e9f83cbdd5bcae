"""kill -9 of every part in simulated time: detection, motion, restart; see test_wall_clock.py."""

from __future__ import annotations

import json
from functools import partial

import numpy as np
import psutil
import pytest

from tests.system.robot import DEMO, Robot, wait_for
from trocar.shm.mailbox.client import Client
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory

pytestmark = [pytest.mark.slow, pytest.mark.simulated]
PLACE = (0.1, -0.1, 0.12, 0.0, 0.0, 0.0)
ELSEWHERE = (0.6, 0.4, 0.16, 0.3, 0.2, -0.2)


def homed(robot: Robot) -> None:
    """The demo robot, powered and homed."""
    robot.up()
    robot.home()


def move(robot: Robot, goal: tuple[float, ...]) -> None:
    """Ask PSM1 for a move; returns when it was accepted."""
    client = Client(robot.name, "PSM1")
    number = client.send("move_jp", goal)
    replies: list[str] = []

    def answered() -> bool:
        replies.extend(r.outcome for r in client.poll() if r.id == number)
        return bool(replies)

    wait_for(answered, 20, "an answer to move_jp")
    client.close()
    assert replies[0] in ("accepted", "done")


def arm_value(robot: Robot, name: str) -> np.ndarray:
    """One field of PSM1's newest record."""
    reader = directory.reader(robot.name, "PSM1", "state")
    assert reader.newest()
    value = reader.field(name).copy()
    reader.close()
    return value


def at(robot: Robot, goal: tuple[float, ...]) -> bool:
    """The setpoint is at the goal, the measured position close by."""
    return bool(
        np.abs(arm_value(robot, "setpoint_position")[:6] - goal).max() < 1e-6
        and np.abs(arm_value(robot, "position")[:6] - goal).max() < 0.05
    )


def test_arm_killed_during_a_move_holds_and_comes_back(robot: Robot) -> None:
    homed(robot)
    move(robot, PLACE)
    wait_for(lambda: at(robot, PLACE), 30, "the first move")
    io = directory.reader(robot.name, "IO1", "state")
    generation = int(arm_value(robot, "bias_generation"))
    missed, epoch = robot.cell("IO1", "missed"), io.epoch
    move(robot, ELSEWHERE)
    wait_for(lambda: bool(arm_value(robot, "setpoint_position")[0] > 0.2), 20, "half of the second move")
    assert io.newest()
    first = int(io.field("cycle"))
    old = robot.kill("PSM1")
    held: list[bool] = []

    def is_back() -> bool:
        held.append(bool(io.newest() and io.field("holding").any()))
        return robot.pid("PSM1") != old and robot.state("PSM1") == "RUNNING"

    wait_for(is_back, 30, "the arm's restart")
    wait_for(lambda: bool(arm_value(robot, "is_homed")), 60, "homed again, by shared memory alone")
    history = io.last(4000)
    history = history[history["cycle"] >= first]
    setpoints = history["setpoint_position"][:, :3]
    steps = np.abs(np.diff(setpoints, axis=0))
    assert history["pid_enabled"].all(), "the joint controller never let go"
    assert any(held) or history["holding"].any(), "io says that it held"
    assert steps.max(axis=0)[0] < 0.01, "no jump of the setpoint"
    assert io.newest()
    assert int(io.field("cycle")) > first
    assert io.epoch == epoch
    assert robot.cell("IO1", "missed") == missed, "I/O does not miss a beat"
    assert np.all(np.diff(history["stamp_ns"]) < 2_100_000)
    assert int(arm_value(robot, "bias_generation")) == generation
    move(robot, PLACE)
    wait_for(lambda: at(robot, PLACE), 30, "a new move without re-homing")
    io.close()


def fired(boards: RingReader) -> bool | None:
    """Whether every watchdog has, in the next record; None: there is none yet."""
    return bool(boards.field("watchdog").all()) if boards.next() else None


def test_boards_cut_the_amplifiers_when_io_is_killed(robot: Robot) -> None:
    homed(robot)
    boards = directory.reader(robot.name, "boards", "state")
    old = robot.kill("IO1")
    last = directory.reader(robot.name, "IO1", "state").head
    wait_for(lambda: any(iter(partial(fired, boards), None)), 60, "every watchdog fired")
    after_ns = boards.field("watchdog_ns") - boards.field("refresh_ns")
    assert np.all(after_ns <= 30_100_000), "within the watchdog time, by the boards' own clock"
    assert np.all(after_ns >= 29_900_000)
    assert not boards.field("amp_on").any()
    boards.close()
    state = json.loads(robot.trocar("echo", "PSM1/operating_state", "--json", "--once"))
    wait_for(lambda: bytes(arm_value(robot, "state")[()]) == b"FAULT", 60, f"FAULT, not {state}")
    wait_for(lambda: robot.pid("IO1") != old and robot.state("IO1") == "RUNNING", 30, "io's restart")
    io = directory.reader(robot.name, "IO1", "state")
    wait_for(lambda: io.newest() and io.head > last and not io.field("powered").any(), 60, "records of the new io")
    assert io.epoch == 2
    assert not io.field("powered").any()
    assert not io.field("pid_enabled").any()
    io.close()
    robot.trocar("power-on")
    robot.home()
    move(robot, PLACE)
    wait_for(lambda: at(robot, PLACE), 30, "a move after the recovery")


def test_everything_ends_when_the_supervisor_is_killed(robot: Robot) -> None:
    robot.up()
    robot.trocar("power-on")
    pids = [robot.pid(i) for i in ("boards", "IO1", "PSM1")]
    robot.kill("supervisor")
    assert robot.supervisor is not None
    robot.supervisor.wait(60)
    wait_for(lambda: not any(psutil.pid_exists(p) for p in pids), 60, "every process ends by itself")
    robot.up()
    assert "that a crashed system left" in robot.output()


def test_a_second_system_of_the_same_name_is_refused(robot: Robot) -> None:
    robot.up()
    reported = robot.trocar("up", str(DEMO), "--system", robot.name, code=1)
    assert "is up already" in reported
    assert robot.state("PSM1") == "RUNNING"
