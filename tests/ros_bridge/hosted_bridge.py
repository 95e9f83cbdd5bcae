"""A system in this process with its ROS bridge, stepped by turns; clients share the bridge's participant."""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any, Final
from unittest import mock

from tests.host.hosted import QUICK, document
from tests.rl.running import home
from trocar.procs.host.host import Host
from trocar.procs.node.life import document_of
from trocar.procs.node.node import Node
from trocar.procs.ros_bridge import loop
from trocar.procs.ros_bridge.loop import RosLoop
from trocar.procs.ros_messages.dds import Participant
from trocar.procs.ros_messages.messages import Log, String
from trocar.shm.mailbox.origins import ACTING

STEP_S: Final = 0.05
SILENT_S: Final = 1.1
"""A text that was published is published again after a second."""
COUNTER: Final = itertools.count()


class HostedBridge:
    """Messages come and go; `run` gives the bridge time to pass them on."""

    def __init__(self, host: Host) -> None:
        self.host, self.loop = host, RosLoop(Node(document_of(host.name), "ros_bridge"))
        self.loop.begin()
        self.loop._incoming._joined_ns = 0  # streams of tests begin with the bridge
        self._participant: Participant = self.loop.participant
        self._readers: dict[str, Any] = {}
        self._writers: dict[str, Any] = {}
        self._passed_s, self._sent_s = 0.0, dict[str, float]()

    def hear(self, topic: str, message: Any) -> None:
        """Subscribe."""
        self._readers[topic] = self._participant.reader(topic, message, 100)

    def came(self, topic: str) -> list[Any]:
        """Messages since the last call."""
        return list(self._readers[topic].take())

    def tell(self, topic: str, message: Any, seconds: float = 0.2) -> None:
        """Publish, and let it take effect."""
        self.tell_together([(topic, message)], seconds)

    def tell_together(self, messages: Sequence[tuple[str, Any]], seconds: float) -> None:
        """Publish these one after the other before the bridge looks again."""
        for topic, message in messages:
            if topic not in self._writers:
                self._writers[topic] = self._participant.writer(topic, type(message))
        for topic, message in messages:
            self._writers[topic].write(message)
        self.run(seconds)

    def run(self, seconds: float) -> None:
        """Of the system's time."""
        for _ in range(max(1, round(seconds / STEP_S))):
            self.loop._rest(1_000_000, False)
            self.host.run(STEP_S)
            self.loop.update()
            self._passed_s += STEP_S
        self.loop._rest(0, False)

    def run_until(self, condition: Callable[[], object], seconds: float = 2.0) -> None:
        """Until this is so, or for so long; what a test then asserts says what was missing."""
        end_s = self._passed_s + seconds
        while not condition() and self._passed_s < end_s:
            self.run(STEP_S)

    def warned(self, component: str) -> list[str]:
        """Texts of a component's warnings."""
        return [message.data for message in self.came(f"{component}/warning")]

    def refused(self, topic: str, message: Any, *components: str) -> dict[str, list[str]]:
        """What is published on the components' topics and /rosout about a message; the arm must not move for it."""
        for component in components:
            if f"{component}/warning" not in self._readers:
                self.hear(f"{component}/warning", String)
        if "/rosout" not in self._readers:
            self.hear("/rosout", Log)
        sent = f"{topic} {message}"
        self.run(max(0.1, SILENT_S + self._sent_s.get(sent, -SILENT_S) - self._passed_s))
        self._sent_s[sent] = self._passed_s
        for each in self._readers:
            self.came(each)
        self.tell(topic, message)
        found = {component: self.warned(component) for component in components}
        return found | {"/rosout": [line.msg for line in self.came("/rosout")]}

    def close(self) -> None:
        """End the bridge."""
        self.loop.quit()
        self.loop.node.close()


@contextmanager
def bridged(arms: Sequence[str] = ("PSM1",), sets: Sequence[str] = (),
            file: str = "kinematic.yaml") -> Iterator[HostedBridge]:
    """A system of ours with a bridge, and these arms homed. A slow machine is no stall of the bridge."""
    acting = ACTING.origin
    domain = f"ros.domain={(os.getpid() + next(COUNTER)) % 231 + 1}"
    with Host(document(file, sets=(*QUICK, domain, *sets))) as host, mock.patch.object(loop, "boottime_ns", lambda: 0):
        host.run(0.1)  # io and arms see each other
        home(host, *arms)
        made = HostedBridge(host)
        try:
            yield made
        finally:
            made.close()
            ACTING.origin = acting
