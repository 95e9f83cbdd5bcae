"""A whole system with a ROS bridge in a process of its own, whose time passes only as a test asks over a pipe."""

from __future__ import annotations

import contextlib
import pickle
import subprocess
import sys
from collections.abc import Sequence
from typing import Any, Final
from unittest import mock

from trocar.procs.document.system import SystemConfig
from trocar.procs.host.host import Host
from trocar.procs.machine.paths import ROOT
from trocar.procs.node.node import Node
from trocar.procs.ros_bridge import loop
from trocar.procs.ros_bridge.loop import RosLoop
from trocar.shm.ring.ring import RingReader

HISTORY: Final = 512


class SteppedSystem:
    """A host with clients of some components."""

    def __init__(self, host: Host, names: Sequence[str]) -> None:
        self.host = host
        self.clients = {name: host.client(name) for name in names}
        self.readers: dict[str, RingReader] = {name: host.reader(name) for name in names}

    def sent(self, name: str, command: str, values: Sequence[float] = (), text: str = "") -> int:
        """A command of an operator; its number."""
        return self.clients[name].send(command, tuple(values), text)

    def outcomes(self, name: str, number: int) -> list[str]:
        """Of that command, since the last call."""
        return [reply.outcome for reply in self.clients[name].poll() if reply.id == number]

    def value(self, name: str, field: str) -> Any:
        """Of the newest record."""
        reader = self.readers[name]
        assert reader.newest(), name
        return reader.field(field).copy()


class BridgedSystem(SteppedSystem):
    """The same with its ROS bridge."""

    def __init__(self, host: Host, names: Sequence[str]) -> None:
        super().__init__(host, names)
        self.bridge = RosLoop(Node(host.document, "ros_bridge"))
        self.bridge.setup()
        self.bridge._incoming._joined_ns = 0  # streams of tests begin with the bridge

    def run(self, seconds: float) -> None:
        """Take messages, let time pass, publish."""
        self.bridge._rest(0, False)
        self.host.run(seconds)
        self.bridge.update()


def main() -> None:
    """In the process: carry out calls until the pipe closes. A slow machine is no stall of the bridge."""
    calls, answers = sys.stdin.buffer, sys.stdout.buffer
    document, names = pickle.load(calls)
    with Host(document, HISTORY) as host, mock.patch.object(loop, "boottime_ns", lambda: 0):
        system = BridgedSystem(host, names)
        with contextlib.suppress(EOFError):
            while True:
                method, *given = pickle.load(calls)
                pickle.dump(getattr(system, method)(*given), answers)
                answers.flush()
        system.bridge.quit()
        system.bridge.node.close()


class SystemProcess:
    """The process from outside, with the methods of `BridgedSystem`."""

    def __init__(self, document: SystemConfig, names: Sequence[str]) -> None:
        words = [sys.executable, "-m", "tests.tools.from_ros.distant_system"]
        self.process = subprocess.Popen(words, cwd=ROOT, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self._tell((document, names))

    def _tell(self, thing: object) -> None:
        assert self.process.stdin is not None
        pickle.dump(thing, self.process.stdin)
        self.process.stdin.flush()

    def __getattr__(self, method: str) -> Any:
        def call(*given: Any) -> Any:
            assert self.process.stdout is not None
            self._tell((method, *given))
            return pickle.load(self.process.stdout)

        return call

    def close(self) -> None:
        """An orderly end."""
        self.process.communicate(timeout=30.0)


if __name__ == "__main__":
    main()
