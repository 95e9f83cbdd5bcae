"""A KINEMATIC arm and its io in their own shared memory, stepped cycle by cycle to measure the duration of a cycle."""

from __future__ import annotations

import time
from typing import Any, Self

from trocar.procs.arm.arm import ArmLogic
from trocar.procs.arm.loop import ArmLoop
from trocar.procs.document.system import SystemConfig
from trocar.procs.io.assemble import IoContext
from trocar.procs.io.kinematic import kinematic_io
from trocar.procs.io.record import IoRecord
from trocar.procs.io.setpoint_rings import RingSource
from trocar.procs.node.node import Node
from trocar.procs.supervisor import memory
from trocar.shm.mailbox.client import Client
from trocar.shm.memory.parts import remove_all

PERIOD_NS = 666_667


class SteppedArm:
    """The first arm of a system, and the io of its kinematic robot."""

    def __init__(self, system: SystemConfig) -> None:
        """Make the shared memory of the system; it is removed at the end."""
        self.name = system.name
        self.now_ns = 1_000_000_000
        row = system.arms[0]
        self.arm_name = row.name
        memory.create_all(system)
        self._io_process = Node(system, row.io)
        self._arm_process = Node(system, row.name)
        self._out, self._io_mailbox = self._io_process.writes("state"), self._io_process.mailbox()
        sources = [RingSource(self._io_process.reads(pid.arm, "setpoint")) for pid in system.io(row.io).pids]
        self._core = kinematic_io(IoContext(system.io(row.io), lambda: self.now_ns, IoRecord(self._out.field), sources))
        self.loop = ArmLoop(self._arm_process)
        self.loop.setup()
        self._client = Client(self.name, row.name)

    @property
    def arm(self) -> ArmLogic:
        """The arm itself."""
        return self.loop.arm

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._client.close()
        for process in (self._arm_process, self._io_process):
            process.close()
        remove_all(self.name)

    def send(self, name: str, values: Any = (), text: str = "") -> None:
        """Send a command for the arm's next cycle."""
        self._client.poll()
        self._client.send(name, values, text)

    def step(self, sway: float = 0.0) -> int:
        """Run a cycle of io, then one of the arm; returns the CPU time of the latter, ns.

        `sway`: an offset on measured values [rad, m, rad/s, m/s, N·m or N], because no real robot is quite still.
        """
        self.now_ns += PERIOD_NS
        self._core.cycle(self._io_mailbox.drain(0))
        self._core.reports.events.clear()
        if sway:
            for name in ("position", "velocity", "effort"):
                self._out.field(name)[...] += sway
        self._out.publish(self._core.stamp_ns)
        begin = time.thread_time_ns()
        self._arm_process.now_ns = self.now_ns
        self.loop.update()
        return time.thread_time_ns() - begin
