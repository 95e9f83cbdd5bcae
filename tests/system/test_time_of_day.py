"""The time of day is set back while the ROS bridge runs: Cyclone DDS waits by it.

The machine's clock stays as it is (shifted_clocks.py).
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.system.robot import ROOT, Robot, wait_for
from tests.system.shifted_clocks import ShiftedClocks
from tests.system.test_ros_bridge import Client, file_with
from trocar.procs.ros_messages.messages import JointStates

pytestmark = pytest.mark.slow
HOUR_S = 3600.0
WAITS = """
import sys, threading
from trocar.procs.ros_messages.dds import Participant
from trocar.procs.ros_messages.messages import Bool
node = Participant(int(sys.argv[1]))
node.reader("never", Bool)
node.wait(0)
threading.Timer(0.5, print, ("waiting",), {"flush": True}).start()
node.wait(2_000_000_000)
"""


@pytest.fixture
def clocks(tmp_path: Path) -> ShiftedClocks:
    return ShiftedClocks(tmp_path)


@pytest.mark.patient
def test_a_wait_for_messages_ends_in_time_when_the_time_of_day_is_set_back(clocks: ShiftedClocks) -> None:
    with subprocess.Popen([sys.executable, "-P", "-c", WAITS, str(1 + os.getpid() % 230)], stdout=subprocess.PIPE,
                          text=True, env={**os.environ, **clocks.environment}) as waiting:
        try:
            assert waiting.stdout is not None and waiting.stdout.readline() == "waiting\n"
            clocks.jump(local_s=-HOUR_S)
            wait_for(lambda: waiting.poll() is not None, 60, "the end of a wait of 2 s")
            assert waiting.returncode == 0
        finally:
            waiting.kill()


@pytest.mark.simulated("paced")
def test_a_bridge_whose_time_of_day_is_set_back_is_found_by_nodes_that_start_then(
        robot: Robot, tmp_path: Path, clocks: ShiftedClocks) -> None:
    made, domain = file_with(tmp_path)
    robot.environment |= clocks.environment
    robot.up(made, "--path", str(ROOT / "configs"))
    wait_for(lambda: robot.state("ros_bridge") == "RUNNING", 60, "the bridge")
    before = robot.pid("ros_bridge")
    clocks.jump(local_s=-HOUR_S)
    wait_for(lambda: robot.pid("ros_bridge") != before and robot.state("ros_bridge") == "RUNNING", 60, "a new bridge")
    assert "time of day was set back by 3600.0 s" in robot.trocar("logs", "ros_bridge")
    client = Client(domain)
    try:
        client.hear("PSM1/measured_js", JointStates)
        client.wait(lambda: client.got["PSM1/measured_js"], "joints")
    finally:
        client.close()
