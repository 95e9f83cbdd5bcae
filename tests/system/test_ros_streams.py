"""Streams of goals from ROS: who streams, what ends a stream, and a bridge that dies or stops in one."""

from __future__ import annotations

import contextlib
import copy
import os
import pickle
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.system.robot import ROOT, Robot, wait_for
from tests.system.test_ros_bridge import Client, bridged, echo_position
from trocar.procs.ros_messages.messages import Empty, JointStates, MessageHeader, Pose, PoseStamped
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.system_time import SystemTime

pytestmark = [pytest.mark.slow, pytest.mark.simulated("paced")]
ENDED = "this stream has ended: ros_bridge stopped the arm (hold)"


class OtherNode:
    """A node of another process, with a participant of its own."""

    def __init__(self, domain: int) -> None:
        code = f"from tests.system.test_ros_streams import publish; publish({domain})"
        self._process = subprocess.Popen([sys.executable, "-c", code], cwd=ROOT, stdin=subprocess.PIPE,
                                         stdout=subprocess.PIPE)

    def tell(self, topic: str, message: Any) -> None:
        assert self._process.stdin is not None and self._process.stdout is not None
        pickle.dump((topic, message), self._process.stdin)
        self._process.stdin.flush()
        assert self._process.stdout.readline()

    def close(self) -> None:
        self._process.communicate(timeout=30)


def publish(domain: int) -> None:
    """Publish what comes through standard input, until it ends."""
    client = Client(domain)
    with contextlib.suppress(EOFError):
        while True:
            client.tell(*pickle.load(sys.stdin.buffer))
            print("published", flush=True)
    client.close()


class StreamedGoals:
    """Goals of one stream, each a little farther than the one before."""

    def __init__(self, client: Client, of_tip: bool) -> None:
        self._client, self._of_tip = client, of_tip
        self.joints: list[float] = []
        self._pose = Pose()

    def begin(self, count: int) -> None:
        """From where the arm is."""
        self.joints = list(self._client.last("PSM1/measured_js").position)
        self._pose = copy.deepcopy(self._client.last("PSM1/measured_cp").pose)
        self.send(count)

    def send(self, count: int) -> None:
        for _ in range(count):
            self.joints[0] += 0.0005
            self._pose.position.x += 0.00005
            if self._of_tip:
                self._client.tell("PSM1/servo_cp", PoseStamped(MessageHeader(), self._pose))
            else:
                self._client.tell("PSM1/servo_jp", JointStates(position=self.joints))
            self._client.spin()


def test_one_node_streams_at_a_time_and_another_one_ends_that(robot: Robot, tmp_path: Path) -> None:
    with bridged(robot, tmp_path) as first, contextlib.closing(OtherNode(first.domain)) as second:
        first.hear("PSM1/jaw/setpoint_js", JointStates)
        first.state("DISABLED")
        first.home()
        first.wait(lambda: first.last("PSM1/measured_js").header.stamp.sec > 0, "joints")
        stream = StreamedGoals(first, of_tip=False)

        def warned(text: str) -> bool:
            return any(text in each.data for each in first.got["PSM1/warning"])

        def reached() -> bool:
            return np.allclose(first.last("PSM1/measured_js").position, stream.joints, atol=1e-6)

        def jaw() -> float:
            return float(first.last("PSM1/jaw/setpoint_js").position[0])

        def streams_before_and_after(topic: str, message: Any) -> None:
            stream.begin(30)
            second.tell(topic, message)
            stream.send(30)

        far = [-0.5, *first.last("PSM1/measured_js").position[1:]]
        first.repeat(lambda: streams_before_and_after("PSM1/servo_jp", JointStates(position=far)),
                     lambda: warned("ros_bridge is streaming") and reached(), "only the first one is followed")
        first.repeat(lambda: streams_before_and_after("PSM1/jaw/servo_jp", JointStates(position=[0.1])),
                     lambda: reached() and abs(jaw() - 0.1) < 1e-6, "both are followed")
        assert not warned(ENDED)

        def holds_and_goes_on() -> None:
            stream.begin(30)
            first.tell("PSM1/hold", Empty())
            stream.send(60)

        first.repeat(holds_and_goes_on, reached, "it goes on after a hold of its own")
        assert not warned(ENDED)
        first.repeat(lambda: streams_before_and_after("PSM1/hold", Empty()),
                     lambda: warned(ENDED) and not reached(), "a hold of the other one ends it")
        first.repeat(lambda: stream.begin(60), reached, "it is followed again after a pause")


@pytest.mark.parametrize(("how", "of_tip"), [(signal.SIGKILL, False), (signal.SIGSTOP, False), (signal.SIGSTOP, True)])
def test_an_arm_whose_bridge_dies_or_stops_in_a_stream_stays_where_it_is(
        robot: Robot, tmp_path: Path, how: signal.Signals, of_tip: bool) -> None:
    with bridged(robot, tmp_path, "backoff_s=8") as client:  # what is sent meanwhile is sent while there is none
        client.state("DISABLED")
        client.home()
        client.wait(lambda: client.last("PSM1/measured_js").header.stamp.sec > 0, "joints")
        stream, began = StreamedGoals(client, of_tip), echo_position(robot)
        client.insist(lambda: stream.begin(100),
                      lambda: not np.allclose(echo_position(robot), began, atol=1e-3), "the arm to follow")
        stream.send(20)
        pid = robot.pid("ros_bridge")
        os.kill(pid, how)
        with SystemTime(robot.name) as system_time:
            system_time.pause(0.2, 60.0)  # what waits for the arm is carried out
        stood = echo_position(robot)
        stream.send(50)
        if how == signal.SIGSTOP:
            wait_for(lambda: monotonic_ns() - robot.cell("ros_bridge", "heartbeat_ns") > 1.5e9, 60, "a long pause")
        assert np.allclose(echo_position(robot), stood, atol=1e-4), "nobody else moves it"
        if how == signal.SIGSTOP:
            os.kill(pid, signal.SIGCONT)
        wait_for(lambda: robot.state("ros_bridge") == "RUNNING", 60, "the bridge to be back")
        client.wait(lambda: len(client.got["PSM1/operating_state"]) > 0, "it to be heard")
        assert np.allclose(echo_position(robot), stood, atol=1e-4), "nor does what came meanwhile"
