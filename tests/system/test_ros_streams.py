"""Streams of goals from ROS: who streams, what ends a stream, and a bridge that dies or stops in one."""

from __future__ import annotations

import contextlib
import copy
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from tests.system.conftest import systems
from tests.system.robot import ROOT, wait_for
from tests.system.test_ros_bridge import Client, bridged, echo_position
from trocar.procs.ros_messages.messages import Empty, JointStates, MessageHeader, Pose, PoseStamped
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.system_time import SystemTime

pytestmark = [pytest.mark.slow, pytest.mark.simulated("paced")]
KINEMATIC = ROOT / "configs/systems/kinematic.yaml"
ENDED = "this stream has ended: ros_bridge for client stopped the arm (hold)"


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
    client.participant.announce()  # as the node "client"
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


@pytest.fixture(scope="module")
def first(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Client]:
    """A client of a system whose arm is homed; what is sent while there is no bridge is sent within its `backoff_s`."""
    folder = tmp_path_factory.mktemp("streams")
    with systems(folder, "paced") as make, bridged(make(), folder, "processes.ros_bridge.backoff_s=2",
                                                   file=KINEMATIC) as client:
        client.hear("PSM1/jaw/setpoint_js", JointStates)
        client.state("DISABLED")
        client.home()
        client.wait(lambda: client.last("PSM1/measured_js").header.stamp.sec > 0, "joints")
        yield client


def test_one_node_streams_at_a_time_and_another_one_ends_that(first: Client) -> None:
    with contextlib.closing(OtherNode(first.domain)) as second:
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

        def holds_and_streams_on() -> None:
            stream.begin(30)
            first.tell("PSM1/hold", Empty())
            stream.send(60)

        first.repeat(holds_and_streams_on, reached, "it is followed after a hold of its own")
        assert not warned(ENDED)
        first.repeat(lambda: streams_before_and_after("PSM1/hold", Empty()),
                     lambda: warned(ENDED) and not reached(), "a hold of the other one ends it")
        first.repeat(lambda: stream.begin(60), reached, "it is followed again after a pause")


@pytest.mark.parametrize(("how", "of_tip"), [(signal.SIGKILL, False), (signal.SIGSTOP, False), (signal.SIGSTOP, True)])
def test_an_arm_whose_bridge_dies_or_stops_in_a_stream_stays_where_it_is(
        first: Client, how: signal.Signals, of_tip: bool) -> None:
    robot = first.robot
    assert robot is not None
    stream, began, pid = StreamedGoals(first, of_tip), echo_position(robot), robot.pid("ros_bridge")
    first.repeat(lambda: stream.begin(50), lambda: not np.allclose(echo_position(robot), began, atol=1e-3),
                 "the arm to follow, though a bridge that has just begun takes this for the stream before", 1.0)
    stream.send(20)
    os.kill(pid, how)
    with SystemTime(robot.name) as system_time:
        system_time.pause(0.2, 60.0)  # what waits for the arm is carried out
    stood = echo_position(robot)
    stream.send(50)
    if how == signal.SIGSTOP:
        wait_for(lambda: monotonic_ns() - robot.cell("ros_bridge", "heartbeat_ns") > 1.5e9, 60, "a long pause")
    assert np.allclose(echo_position(robot), stood, atol=1e-4), "nothing else moves it"
    if how == signal.SIGSTOP:
        os.kill(pid, signal.SIGCONT)
    else:
        wait_for(lambda: robot.pid("ros_bridge") != pid, 60, "another bridge")
        robot.pids.add(robot.pid("ros_bridge"))
    wait_for(lambda: robot.state("ros_bridge") == "RUNNING", 60, "the bridge to be back")
    first.got["PSM1/operating_state"].clear()
    first.wait(lambda: len(first.got["PSM1/operating_state"]) > 0, "it to be heard")
    assert np.allclose(echo_position(robot), stood, atol=1e-4), "what was sent meanwhile moves nothing"
