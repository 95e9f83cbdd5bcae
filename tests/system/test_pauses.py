"""SIGSTOP of every part and SIGCONT a while later, on the wall clock: it behaves as if it had been killed."""

from __future__ import annotations

import os
import signal
from collections.abc import Iterator

import numpy as np
import pytest

from tests.system.robot import DEMO, ROOT, SLOWER, Robot, wait_for
from trocar.shm.mailbox.client import Client, Reply
from trocar.shm.ring.ring import RingReader
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns, pause

pytestmark = pytest.mark.slow
TELEOP = ROOT / "configs/systems/kinematic-teleop.yaml"
NAME = "MTMR_PSM1"
PAUSE_S = 0.4
NOTICED_NS = 60_000_000  # io holds, watchdogs have fired, and a busy machine
STILL_M, STILL_RAD = 1e-5, 0.02
EFFORT = 3  # control mode


def patient(*names: str) -> list[str]:
    """Options by which a busy machine, that holds these up for longer than we do, makes nobody kill them or end."""
    sets = ["supervisor_lost_s=60", *(f"processes.{name}.hung_s=60" for name in names)]
    return [word for each in sets for word in ("--set", each)]


class Part:
    """One process: its record, what it said, and a client of its own."""

    def __init__(self, robot: Robot, name: str, kind: str) -> None:
        self.robot, self.name = robot, name
        self.ring = directory.reader(robot.name, name, "state", kind)
        self.events = directory.reader(robot.name, name, "events", kind)
        self.client = Client(robot.name, name)
        self.replies: list[Reply] = []

    def value(self, field: str) -> np.ndarray:
        assert self.ring.newest()
        return self.ring.field(field).copy()

    def text(self, field: str) -> str:
        return bytes(self.value(field).item()).decode()

    def answers(self, number: int) -> list[tuple[str, str]]:
        self.replies += self.client.poll()
        return [(reply.outcome, reply.text) for reply in self.replies if reply.id == number]

    def stall(self) -> int:
        """Stop it, and let it run again after a while; returns when it was stopped, monotonic ns."""
        pid = self.robot.pid(self.name)
        os.kill(pid, signal.SIGSTOP)
        try:
            stopped_ns, epoch = monotonic_ns(), self.ring.epoch
            pause(PAUSE_S)
        finally:
            os.kill(pid, signal.SIGCONT)
        wait_for(lambda: self.ring.epoch > epoch, 10, f"{self.name} restarts")
        assert self.robot.pid(self.name) == pid, "the same process"
        reported = [row["text"].decode() for row in self.events.last(100) if row["code"] == b"held-up"]
        assert reported[-1].startswith(f"{self.name} stalled for ")
        wait_for(lambda: self.ring.newest() and self.ring.stamp_ns > stopped_ns + PAUSE_S * 1e9, 10, "its record")
        return stopped_ns

    def close(self) -> None:
        for part in (self.ring, self.events, self.client):
            part.close()


def parts(robot: Robot, **kinds: str) -> list[Part]:
    return [Part(robot, name, kind) for name, kind in kinds.items()]


def went(ring: RingReader, field: str, since_ns: int, axes: int) -> float:
    """How far a record's first numbers went at most, from then on."""
    return float(np.ptp(ring.since(since_ns)[field][:, :axes], axis=0).max())


def has_stalled(answers: list[tuple[str, str]], name: str) -> bool:
    return bool(answers) and answers[-1][0] == "failed" and answers[-1][1].startswith(f"{name} stalled for ")


def test_a_process_that_stalls_while_a_slave_follows_ends_that_until_presence_is_shown_again(robot: Robot) -> None:
    robot.up(TELEOP, *SLOWER, *patient(NAME, "console", "system"))
    all_parts = parts(robot, MTMR_PSM1="teleop", MTMR="arm", PSM1="arm", console="console", system="system")
    teleop, master, slave, console, system = all_parts
    homing = system.client.send("home")
    wait_for(lambda: system.text("task") == "home", 10, "homing")
    system.stall()
    wait_for(lambda: has_stalled(system.answers(homing), "system"), 10, "an answer to who waits for it")
    robot.insist("send", "system", "home", "--wait")

    def following(wanted: bool) -> None:
        wait_for(lambda: bool(teleop.value("following")) is wanted, 20, f"following: {teleop.text('reason')}")

    def show_presence() -> None:
        console.client.send("emulate_operator_present", (0,))
        wait_for(lambda: not console.value("operator_present"), 10, "the operator is seen to have gone")
        console.client.send("emulate_operator_present", (1,))
        following(True)

    console.client.send("teleop_enable", (1,))
    show_presence()
    for held in (teleop, console):
        begin, goal = slave.value("setpoint_cp"), master.value("setpoint_cp")
        goal[0] += 0.05 if held is teleop else -0.05
        number = master.client.send("move_cp", goal)
        wait_for(lambda: np.linalg.norm(slave.value("setpoint_cp")[:3] - begin[:3]) > 1e-3, 10, "the slave follows")  # noqa: B023
        stopped_ns = held.stall()
        wait_for(lambda: len(master.answers(number)) > 1, 20, "the hand was moved on, until alignment held it")  # noqa: B023
        assert went(slave.ring, "setpoint_cp", stopped_ns + NOTICED_NS, 3) < STILL_M, "the slave stays where it was"
        assert not teleop.value("following")
        assert held is teleop or not console.value("operator_present"), "nobody is seen who was not seen since"
        at = slave.value("setpoint_cp")
        show_presence()
        assert np.abs(slave.value("setpoint_cp") - at).max() < 1e-4, "no jump when it follows again"
    for part in all_parts:
        part.close()
    assert robot.down() == 0


@pytest.fixture
def demo_parts(robot: Robot) -> Iterator[list[Part]]:
    robot.up(DEMO, *SLOWER, *patient("PSM1", "IO1"))
    made = parts(robot, PSM1="arm", IO1="io")
    yield made
    for part in made:
        part.close()


def test_a_robot_whose_arm_or_io_stalled_stands_still_until_an_operator_asks(
    robot: Robot, demo_parts: list[Part]
) -> None:
    arm, io = demo_parts
    boards = directory.reader(robot.name, "boards", "state")
    robot.insist("power-on")
    homing = arm.client.send("state_command", (), "home")
    wait_for(lambda: arm.text("sub_state") not in ("ENABLED", "HOMED"), 20, "homing has begun")
    arm.stall()
    wait_for(lambda: has_stalled(arm.answers(homing), "PSM1"), 10, "an answer to who waits for it")
    wait_for(lambda: arm.text("sub_state") == "ENABLED", 10, "powered")
    assert not arm.value("is_homed")

    robot.insist("home")
    move = arm.client.send("move_jp", (0.6, 0.4, 0.16, 0.3, 0.2, -0.2))
    wait_for(lambda: bool(arm.value("setpoint_position")[0] > 0.1), 20, "some of the move")
    stopped_ns = arm.stall()
    wait_for(lambda: has_stalled(arm.answers(move), "PSM1"), 10, "an answer to who waits for it")
    wait_for(lambda: not bool(arm.value("is_busy")), 10, "it has begun anew, with io's first record")
    assert bool(arm.value("is_homed")) and arm.value("position")[0] < 0.5
    wait_for(lambda: boards.newest() and boards.stamp_ns > stopped_ns + 1_500_000_000, 20, "a while")
    assert went(boards, "position", stopped_ns + 2 * NOTICED_NS, 2) < STILL_RAD, "the robot itself stands still"

    arm.client.send("free")
    wait_for(lambda: arm.value("control_mode") == EFFORT, 10, "effort mode")
    stopped_ns = arm.stall()
    wait_for(lambda: arm.value("control_mode") != EFFORT, 10, "it has begun anew, with io's first record")
    assert bool(arm.value("is_homed"))
    wait_for(lambda: boards.newest() and boards.stamp_ns > stopped_ns + 800_000_000, 20, "a while")
    assert went(boards, "position", stopped_ns + 2 * NOTICED_NS, 2) < STILL_RAD, "io has taken over, the arm holds"

    stopped_ns = io.stall()
    wait_for(lambda: arm.text("state") == "FAULT", 10, f"FAULT, not {arm.text('state')}")
    wait_for(lambda: boards.newest() and boards.stamp_ns > io.ring.stamp_ns + 500_000_000, 10, "half a second more")
    assert not boards.since(stopped_ns + NOTICED_NS)["amp_on"].any(), "no amplifier was on again"
    assert not io.value("powered").any() and not io.value("pid_enabled").any()
    robot.insist("power-on")
    boards.close()
