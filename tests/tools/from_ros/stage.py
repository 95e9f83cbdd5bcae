"""The process of an arm from ROS in the memory of a system without other processes, and a CRTK arm on ROS beside it.

Both use one participant of DDS in a domain of its own; time is the test's.
"""

from __future__ import annotations

import itertools
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final
from unittest import mock

import yaml

from trocar.procs.config import load_system
from trocar.procs.node.life import document_of
from trocar.procs.node.node import Node
from trocar.procs.node.pacing import Pauses
from trocar.procs.ros_messages.dds import Participant, TopicReader, TopicWriter
from trocar.procs.ros_messages.messages import (
    JointStates,
    MessageHeader,
    OperatingState,
    Point,
    Pose,
    PoseStamped,
    Quaternion,
    Time,
)
from trocar.procs.supervisor.memory import create_all
from trocar.shm.mailbox.client import Client, Reply
from trocar.shm.mailbox.generations import Faults
from trocar.shm.mailbox.origins import ACTING
from trocar.shm.memory.parts import remove_all
from trocar.shm.system import directory
from trocar.shm.time.clock import monotonic_ns
from trocar.shm.time.control_page import ControlPage
from trocar.tools.from_ros import arm, remote_commands
from trocar.tools.from_ros.arm import ArmFromRos

MS: Final = 1_000_000
EPOCH_NS: Final = 1_700_000_000_000_000_000
COUNTER: Final = itertools.count()
WAIT_S: Final = 20.0


class RosStage:
    """`step` lets the arm on ROS publish once, and the process take it."""

    def __init__(self, system: str, participant: Participant) -> None:
        self.system, self.participant = system, participant
        self.now_ns = monotonic_ns()
        self.process = ArmFromRos(Node(document_of(system), "PSM1"))
        self.process.setup()
        self.process.node.begin()
        self.now_ns = monotonic_ns()
        self.ring = directory.reader(system, "PSM1", "state", "third_party")
        self.events = directory.reader(system, "PSM1", "events", "third_party")
        self.faults, self.client = Faults(system), Client(system, "PSM1")
        self._writers: dict[str, TopicWriter[Any]] = {}
        self._readers: dict[str, TopicReader[Any]] = {}
        self.frame, self.x, self.jaw = "PSM1_base", 0.0, 0.5
        self.state, self.is_homed, self.is_busy = "ENABLED", True, False

    def time_ns(self) -> int:
        return self.now_ns

    def local_ns(self) -> int:
        return EPOCH_NS + self.now_ns

    @property
    def header(self) -> MessageHeader:
        return MessageHeader(Time(*divmod(self.local_ns(), 1_000_000_000)), self.frame)

    def publish(self, topic: str, message: Any, latched: int = 0) -> None:
        """As the arm does, and until the process has taken it."""
        if topic not in self._writers:
            self._writers[topic] = self.participant.writer(f"/PSM1/{topic}", type(message), latched)
        self._writers[topic].write(message)

    def hear(self, topic: str, message: Any) -> TopicReader[Any]:
        """Subscribe to a command, as the arm does."""
        if topic not in self._readers:
            self._readers[topic] = self.participant.reader(f"/PSM1/{topic}", message, 100)
        return self._readers[topic]

    def pose(self) -> PoseStamped:
        return PoseStamped(self.header, Pose(Point(self.x, 0.0, -0.1), Quaternion()))

    def step(self) -> None:
        """10 ms later."""
        self.now_ns += 10 * MS
        self.publish("jaw/setpoint_js", JointStates(self.header, ["jaw"], [self.jaw]))
        self.publish("setpoint_cp", self.pose())
        self.publish("operating_state", OperatingState(self.header, self.state, self.is_homed, self.is_busy), 1)
        self.publish("measured_cp", self.pose())
        self.take()

    def take(self) -> None:
        """DDS delivers within one participant at once."""
        self.process._take()
        self.process.process_messages()
        self.process.update()

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 100)):
            self.step()

    def come(self) -> None:
        """Until the arm is there."""
        end = time.monotonic() + WAIT_S
        while not self.process.arm.is_there:
            self.step()
            assert time.monotonic() < end, self.process.arm.problem
        self.run(0.05)

    def wait(self, seconds: float) -> None:
        """The arm is silent."""
        for _ in range(round(seconds * 100)):
            self.now_ns += 10 * MS
            self.take()

    def value(self, name: str) -> Any:
        assert self.ring.newest()
        return self.ring.field(name).copy()

    def send(self, name: str, values: Any = (), text: str = "") -> None:
        """A command of an operator."""
        self.client.send(name, values, text)
        self.process.process_messages()
        self.process.commands.flush()

    def replies(self) -> list[Reply]:
        return list(self.client.poll())

    def errors(self) -> list[str]:
        """Texts of errors since the last call."""
        found = []
        while self.events.next():
            if int(self.events.field("severity")) == 3:
                found.append(self.events.field("text").item().decode())
        return found

    def close(self) -> None:
        for part in (self.ring, self.events, self.faults, self.client):
            part.close()
        self.process.quit()
        self.process.node.close()


@contextmanager
def ros_stage(system: str, folder: Path, **keys: Any) -> Iterator[RosStage]:
    """A PSM from ROS in a system of this name; `keys` of its row."""
    domain = (os.getpid() + next(COUNTER)) % 231 + 1
    row = {"name": "PSM1", "type": "PSM_GENERIC", "component": {"from": "ros", "domain": domain}, **keys}
    file = folder / "from-ros.yaml"
    file.write_text(yaml.safe_dump({"$id": "dvrk-system.schema.json", "$version": "1", "arms": [row]}))
    loaded = load_system(file, name=system)
    assert loaded.system is not None, loaded.errors
    create_all(loaded.system)
    page = ControlPage(system, "supervisor", write=True)
    page.field("heartbeat_ns")[...] = monotonic_ns() + 600_000 * MS
    page.show("RUNNING")
    page.close()
    acting, participant = ACTING.origin, Participant(domain)
    shared = mock.Mock(wraps=participant, close=lambda: None)
    stage: list[RosStage] = []

    def now_ns() -> int:
        return stage[0].now_ns if stage else monotonic_ns()

    def day_ns() -> int:
        return stage[0].local_ns()

    try:
        with (mock.patch.object(arm, "Participant", lambda *given: shared),
              mock.patch.object(arm, "monotonic_ns", now_ns), mock.patch.object(arm, "local_ns", day_ns),
              mock.patch.object(remote_commands, "monotonic_ns", now_ns),
              mock.patch.object(remote_commands, "local_ns", day_ns),
              mock.patch("trocar.procs.node.node.Pauses", lambda limit_ns: Pauses(0))):
            stage.append(RosStage(system, participant))
            yield stage[0]
    finally:
        for each in stage:
            each.close()
        participant.close()
        ACTING.origin = acting
        remove_all(system)
