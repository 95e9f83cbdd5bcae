"""The io process: owns its bus, runs robot I/O and joint controllers in one loop, and publishes the results."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Final

import numpy as np

from trocar.procs.document.system import IoConfig
from trocar.procs.io.assemble import IoContext
from trocar.procs.io.bus.bus_port import BusPort, PortOptions
from trocar.procs.io.bus.named_port import hold, port_of
from trocar.procs.io.cycle import RobotIo
from trocar.procs.io.kinematic import kinematic_io
from trocar.procs.io.record import IoRecord
from trocar.procs.io.reports import IoEvent
from trocar.procs.io.robots import ACCELERATION, SOFTWARE_VELOCITY, Robots
from trocar.procs.io.setpoint_rings import RingSource
from trocar.procs.io.start import POWER_OFF, prepare
from trocar.procs.node import runtime
from trocar.procs.node.node import Node
from trocar.shm.mailbox.generations import NoFaults, robot_component
from trocar.shm.memory.layout import shorten
from trocar.shm.system.events import ERROR, STATUS, WARNING

BUTTON: Final = "button"
SEVERITY = {"status": STATUS, "warning": WARNING, "error": ERROR}


class IoLoop(runtime.Loop):
    """One bus: its port, its robots, the sources of their setpoints, and the receivers of its reports."""

    def setup(self) -> None:
        node = self.node
        np.seterr(all="ignore")  # NaN and infinite values are checked, and reported, where they matter
        io = node.document.io(node.name)
        robots = Robots(io)
        self._out, self._mailbox = node.writes("state"), node.mailbox(NoFaults())  # of each robot: see RobotIo
        cells = [node.fault_cell(robot_component(io.name, name)) for name in robots.names]
        for cell in cells:
            cell.fault()  # earlier commands are void: io starts without power
        document, name = node.document, node.name
        arms = [row.name for row in document.arms if row.io == name]
        wired = [row.name for row in document.consoles if row.is_wired_to(name)]
        self._woken = [node.waker_for(each) for each in (*arms, *wired)]
        """They sleep until something is reported."""
        self._others = {topic: node.writes(topic) for topic in ("gains", "instruments")}
        sources = [RingSource(node.reads(pid.arm, "setpoint")) for pid in io.pids]
        now_ns, record, gains = node.clock.now_ns, IoRecord(self._out.field), self._others["gains"].field
        report = self._mailbox.audit.write if self._mailbox.audit is not None else None
        context = IoContext(io, now_ns, record, sources, cells, gains, self._others["instruments"].field, report,
                            node.pauses.is_over, lambda: node.pauses.over_ns)
        if io.port:
            port = self._take_port(io, robots)
            self._core = RobotIo(context, port, prepare(robots, port))
        else:
            self._core = kinematic_io(context)
        node.computes(self._core.halves.why_numpy)
        self._subscriptions, bits = node.subscriptions, node.subscriptions.bits
        self._parts = ((bits("state", "software_velocity"), SOFTWARE_VELOCITY),
                       (bits("state", "acceleration"), ACCELERATION))
        self._show_wanted()

    def _show_wanted(self) -> None:
        """Compute on demand the values that some process wants."""
        wanted = self._subscriptions.wanted
        self._core.want(sum(part for bit, part in self._parts if wanted & bit))

    def _take_port(self, io: IoConfig, robots: Robots) -> BusPort:
        """The port of this io, owned exclusively."""
        node = self.node
        port = port_of(io.port, robots.board_ids, node.clock.now_ns, PortOptions(
            io.protocol, real_time=not node.clock.simulated, first_control=POWER_OFF, spin_ns=node.clock.spin_ns,
            query_wait_ns=round(io.query_wait_us * 1e3) or None, unknown_firmware=io.unknown_firmware))
        node.hold(hold(io.port))
        return node.hold(port)

    def update(self) -> None:
        core, node = self._core, self.node
        if self._subscriptions.look():
            self._show_wanted()
        core.cycle(self._mailbox.drain(node.wall_ns) if self._mailbox.has_news else ())
        events = core.reports.events
        if events:  # before the record: the reports of a fault precede the record that shows it
            _report(node, (event for event in events if event.kind != BUTTON))
            if core.reports.detached:
                text = "; ".join([*core.reports.detached, f"trocar restart {node.name} attaches it again"])
                node.page.field("error")[...] = shorten(text, 399)
        self._out.publish(core.stamp_ns)
        if events:  # after the record, so that it already shows a reported button
            _report(node, (event for event in events if event.kind == BUTTON))
            events.clear()
            for each in self._woken:
                each.wake()
        if core.good:
            node.pacing.latency(core.port.send_ns - core.port.recv_ns)
        while core.reports.changed:
            self._others[core.reports.changed.pop()].publish(core.stamp_ns)

    def quit(self) -> None:
        """Set all outputs to zero; then `node` releases the port."""
        if hasattr(self, "_core"):
            self._core.shutdown()


def main() -> None:
    """Run until stopped; outputs are zero on every path out."""
    runtime.run("io", IoLoop)


def _report(node: Node, events: Iterable[IoEvent]) -> None:
    for event in events:
        node.events.emit(event.kind, event.text, severity=SEVERITY.get(event.kind, 0), code=event.code,
                         component=event.component, axis=event.axis, value=event.value, limit=event.limit,
                         board=event.board, hint=event.hint)


if __name__ == "__main__":
    main()
