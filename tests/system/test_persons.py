"""After a fault nothing powers, homes or moves until a person asks: no pedal, no desired state, no process."""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

import pytest

from tests.system.robot import COARSE_ON_BOARDS, ROOT, TELEOP_AT_500_HZ, Robot, wait_for
from tests.system.robot_in_host import HOSTED
from trocar.shm.system import directory
from trocar.shm.time.system_time import SystemTime
from trocar.tools.client.remote import Remote
from trocar.tools.examples.operator_sim import OperatorSim, SeenRecord

pytestmark = [pytest.mark.slow, pytest.mark.simulated(HOSTED)]
QUIET_S = 2.0
PINCH, NEAR = 1.0, 0.1  # rad


class Operator:
    """Whoever sits at the console of the demo, with a foot on the pedal."""

    def __init__(self, robot: Robot) -> None:
        self.robot, name = robot, robot.name
        self.boards, self.system = Remote(name, "boards"), Remote(name, "system")
        self.truth, self.seat = SeenRecord(name, "boards", "boards"), OperatorSim(name, "console")
        self.io = SeenRecord(name, "IO1", "io")
        self.coag = list(self.io.ring.info["inputs"]).index("coag")
        self.arms = [SeenRecord(name, arm, "arm") for arm in ("MTMR", "PSM1")]
        self.teleop = self.seat.teleops[0]

    def press(self, on: bool) -> None:
        """Until io has seen it: what is shorter than its debouncing was never pressed, nor released."""
        self.boards.ask("press", (float(on),), "coag")
        wait_for(lambda: self.io.value("input")[self.coag] is on, 20, "the pedal seen")

    def pinch(self) -> None:
        angle = float(self.arms[0].value("gripper_position"))
        for closed in (angle - PINCH, angle):
            self.boards.ask("set_position", (closed,), "MTMR_gripper")
            wait_for(lambda at=closed: abs(self.arms[0].value("gripper_position") - at) < NEAR, 20, "the gripper there")

    def follows(self) -> None:
        """Shows presence until the slave follows."""
        self.press(False)
        wait_for(lambda: not self.seat.console.value("operator_present"), 20, "the pedal let go of")
        self.press(True)
        wait_for(lambda: "waiting: pinch" in self.teleop.value("reason"), 60, "presence asked for")
        self.pinch()
        wait_for(lambda: self.teleop.is_following, 30, f"following; {self.teleop.reported}")

    def states(self) -> list[str]:
        return [str(arm.value("sub_state")) for arm in self.arms]

    @property
    def is_powered(self) -> bool:
        return any(self.truth.value("amp_on"))

    def stays_off(self) -> None:
        """No amplifier comes on, whatever the pedal does."""
        with SystemTime(self.robot.name) as clock:
            for pressed in (False, True, False, True):
                self.press(pressed)
                since_ns = clock.now_ns()
                clock.pause(QUIET_S / 4)
                assert clock.now_ns() > since_ns
                rows = self.truth.ring.since(since_ns)
                assert len(rows) and not rows["amp_on"].any(), f"an amplifier came on; arms are {self.states()}"

    def home(self) -> None:
        reply = self.system.settled("home", timeout=90.0)
        assert reply.outcome == "done", reply.text

    def close(self) -> None:
        for part in (self.seat, self.boards, self.system):
            part.__exit__()
        for part in (*self.arms, self.truth):
            part.ring.close()


@pytest.fixture
def operator(robot: Robot) -> Iterator[Operator]:
    robot.up(ROOT / "configs" / "systems" / "demo-teleop.yaml", *COARSE_ON_BOARDS, *TELEOP_AT_500_HZ)
    made = Operator(robot)
    yield made
    made.close()


def audit(robot: Robot, instance: str, kind: str) -> Any:
    ring = directory.reader(robot.name, instance, "audit", kind)
    rows = ring.since(0)
    ring.close()
    return rows


def test_a_fault_under_a_pressed_pedal_leaves_the_robot_off_until_a_person_asks(operator: Operator) -> None:
    robot = operator.robot
    operator.home()
    operator.seat.ask("teleop_enable", 1)
    operator.follows()

    operator.boards.ask("drop_block", (7, 40), "IO1")  # a cable bad for longer than the watchdog time
    wait_for(lambda: not operator.is_powered, 20, "amplifiers off")
    operator.stays_off()
    assert not operator.seat.console.value("teleop_enabled")
    operator.home()
    operator.press(False)
    operator.press(True)
    wait_for(lambda: operator.seat.console.value("operator_present"), 20, "the operator seen")
    assert operator.teleop.value("state") == "DISABLED"  # homed again, but nobody enabled teleoperation since
    old = robot.kill("IO1")
    wait_for(lambda: not operator.is_powered, 20, "amplifiers off")
    wait_for(lambda: robot.pid("IO1") != old and robot.state("IO1") == "RUNNING", 60, "io's restart")
    operator.stays_off()
    operator.home()

    asked = {int(row["origin"]) for row in audit(robot, "system", "system") if row["command"] == b"home"}
    rows = [row for row in audit(robot, "IO1", "io") if row["command"] == b"power_on"]
    powered = {int(row["origin"]) for row in rows if row["outcome"] != b"refused"}
    assert powered and powered <= asked
    assert 0 not in asked
    reported = robot.trocar("logs", "IO1", "--commands", "-n", "200")
    assert re.search(r"IO1: power_on PSM1: accepted; for \w+, number", reported), reported
