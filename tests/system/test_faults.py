"""Faults asked for on the command line are felt by the whole stack, and it recovers from them."""

from __future__ import annotations

import numpy as np
import pytest

from shm import directory
from tests.system.robot import DEMO, Robot, wait_for

pytestmark = pytest.mark.slow


def test_faults_on_command_are_felt_and_recovered_from(robot: Robot) -> None:
    robot.up(DEMO)
    robot.trocar("power-on")
    robot.trocar("home")
    io, arm = (directory.reader(robot.name, instance, "state") for instance in ("IO1", "PSM1"))

    def value(name: str) -> np.ndarray:
        assert io.newest()
        return io.field(name).copy()

    def send(*words: str, code: int = 0) -> str:
        return robot.trocar("send", "boards", *words, code=code)

    def state() -> str:
        assert arm.newest()
        return bytes(arm.field("state")).rstrip(b"\0").decode()

    before = int(value("bad_reads"))
    send("lose_replies", "3", "IO1")
    wait_for(lambda: int(value("bad_reads")) >= before + 3, 10, "three replies missed")
    before = int(value("bad_reads"))
    send("mislabel_replies", "2")
    wait_for(lambda: int(value("bad_reads")) >= before + 2, 10, "two replies not believed")
    assert value("powered").all() and state() == "ENABLED", "some lost replies are tolerated"

    assert "axis 9; allowed: 0 to 6" in send("amp_fault", "PSM1", "9", "1", code=1)
    assert "PSM1_arm_clutch" in send("press", "camera", "1", code=1)

    send("emergency_stop", "1")
    wait_for(lambda: not value("powered").any(), 10, "motor power lost")
    wait_for(lambda: state() == "FAULT", 20, "the arm says FAULT")
    assert not value("relay").any()
    send("emergency_stop", "0")
    robot.trocar("power-on")
    assert value("powered").all() and state() == "ENABLED"

    before = int(value("encoder_bits")[1])
    send("encoder_jump", "PSM1", "1", "-40000")
    wait_for(lambda: int(value("encoder_bits")[1]) < before - 20000, 10, "the jump")
    io.close()
    arm.close()
