"""kill -9 of the process `system` while it homes the arms: it forgets that, no arm gets another command from it."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, closing

import numpy as np
import pytest

from tests.system.robot import Robot, wait_for
from tests.system.robot_in_host import HOSTED
from trocar.shm.mailbox.client import Client
from trocar.shm.mailbox.mailbox import DIED
from trocar.shm.system import directory
from trocar.shm.time.clock import pause

pytestmark = [pytest.mark.slow, pytest.mark.simulated(HOSTED)]
A_WHILE_S = 0.5
STILL = 1e-3  # rad and m


class WatchedHome:
    """PSM1 and the process that homes it."""

    def __init__(self, robot: Robot, held: ExitStack) -> None:
        self.robot = robot
        self.arm, self.audit, self.system = (
            held.enter_context(closing(directory.reader(robot.name, owner, topic)))
            for owner, topic in (("PSM1", "state"), ("PSM1", "audit"), ("system", "state")))
        self.person = held.enter_context(closing(Client(robot.name, "system")))

    def sub_state(self) -> str:
        return self.arm.field("sub_state").item().decode() if self.arm.newest() else ""

    def kill_while(self, sub_state: str) -> list[str]:
        """Ask for homing and kill `system` when the arm shows this; what becomes of the person's command."""
        number = self.person.send("home")
        wait_for(lambda: self.sub_state() == sub_state, 60, sub_state)
        self.robot.kill("system")
        while self.audit.next():
            pass
        pause(0.1)
        self.robot.pid("system")  # its successor runs
        wait_for(lambda: self.sub_state() != sub_state and not self.arm.field("is_busy").item(), 60, "the arm's step")
        pause(A_WHILE_S)
        return [f"{reply.outcome} {reply.text}".strip() for reply in self.person.poll() if reply.id == number]

    def asked(self) -> list[str]:
        """What the arm was asked for since the kill, by anyone."""
        found = []
        while self.audit.next():
            command, text, outcome = (self.audit.field(name).item().decode() for name in ("command", "text", "outcome"))
            if outcome != "done":  # of what had been asked before
                found.append(f"{command} {text}: {outcome}")
        return found


@pytest.fixture
def watched(robot: Robot) -> Iterator[WatchedHome]:
    robot.up()
    with ExitStack() as held:
        yield WatchedHome(robot, held)


def test_a_system_that_dies_while_it_homes_asks_for_nothing_more_until_it_is_asked_again(watched: WatchedHome) -> None:
    for killed_in, then, says in (("POWERING", "ENABLED", "all well; next: trocar home PSM1"),
                                  ("HOMING", "HOMED", "all well")):
        assert watched.kill_while(killed_in) == ["accepted", f"failed {DIED}"], "both are accepted"
        assert watched.sub_state() == then and not watched.asked(), "what the arm had been asked for is finished"
        assert watched.system.newest() and not watched.system.field("task").item()
        assert watched.robot.trocar("status").strip().splitlines()[-1] == says
        before = watched.arm.field("position").copy()
        pause(A_WHILE_S)
        assert watched.sub_state() == then and np.abs(watched.arm.field("position") - before).max() < STILL
    watched.robot.trocar("send", "system", "home", "--wait")
    assert watched.sub_state() == "HOMED" and not watched.asked()
