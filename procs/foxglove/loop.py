"""Topics and the robot in 3D for Foxglove and Lichtblick, over their WebSocket protocol. docs/foxglove.md.

It is read-only, and runs like a user's own process, at ordinary priority: a crash or hang has no effect on the system.
The server of foxglove-sdk has threads of its own.
"""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Final

import foxglove
from foxglove.websocket import Capability, ChannelView, Client, ServerListener

from trocar.procs.crtk.demand import Wanted
from trocar.procs.crtk.topics import EVENT, RECORD, TopicEntry, catalogue
from trocar.procs.crtk.views import Stamps
from trocar.procs.document.process import host_and_port
from trocar.procs.foxglove.channels import ShownEvents, ShownRecords
from trocar.procs.foxglove.scene import RobotScene
from trocar.procs.machine.port_holders import TCP, holders
from trocar.procs.node import runtime
from trocar.procs.user.process import UserLoop
from trocar.shm.system import directory

LOOK_NS: Final = 100_000_000


class Listeners(ServerListener):
    """New subscribers and their channels, reported by the server's threads."""

    def __init__(self) -> None:
        self.begun: deque[str] = deque(maxlen=10_000)

    def on_subscribe(self, client: Client, channel: ChannelView) -> None:
        """Remember it for the next look."""
        self.begun.append(channel.topic)


class FoxgloveLoop(UserLoop):
    """Decides when to publish which data: only topics with subscribers."""

    def setup(self) -> None:
        """Offer all topics; RuntimeError if the address is taken (by whom) or a certificate cannot be used."""
        node, row = self.node, self.node.document.foxglove
        if row is None:
            raise ValueError(f"{self.system} has no Foxglove server")
        self._stamps, self._looked_ns = Stamps(node.simulated), 0
        self._records: list[ShownRecords] = []
        self._events: list[ShownEvents] = []
        rings: dict[tuple[str, str], list[TopicEntry]] = {}
        for entry in catalogue(self.system):
            if entry.fields and not (entry.ring == "events" and entry.kind == RECORD):
                rings.setdefault((entry.instance, entry.ring), []).append(entry)
        demand = node.hold(Wanted(self.system, "foxglove"))
        for (instance, ring), entries in rings.items():
            reader = node.hold(directory.reader(self.system, instance, ring, often=ring == "events"))
            if ring == "events":
                self._events.append(ShownEvents(self.system, reader, [e for e in entries if e.kind == EVENT]))
            else:
                self._records.append(ShownRecords(demand, reader, entries))
        self._scene, self._listeners = RobotScene(node.document.arms, node.reads), Listeners()
        host, port = host_and_port(row.listen)
        certificate, key = (Path(name).read_bytes() if name else None for name in (row.certificate, row.key))
        try:
            self._server = foxglove.start_server(
                name=f"Trocar {self.system}", host=host, port=port, server_listener=self._listeners,
                capabilities=[Capability.Time] if node.simulated else [], tls_cert=certificate, tls_key=key)
        except RuntimeError as error:
            others = "; ".join(map(str, holders(port, host, TCP)))
            raise RuntimeError(f"cannot listen at {row.listen}: {others or error}") from None
        self.log.info("Foxglove: %s://%s", "wss" if row.certificate else "ws", row.listen)

    def update(self) -> None:
        """Publish the topics with subscribers."""
        stamps, now_ns = self._stamps, self.node.now_ns
        stamps.look()
        if now_ns - self._looked_ns >= LOOK_NS:
            self._looked_ns = now_ns
            self._look(stamps.ns(now_ns))
        for records in self._records:
            records.step(stamps)
        for events in self._events:
            events.step(stamps)
        self._scene.step(stamps, stamps.ns(now_ns))
        if self.node.simulated:
            self._server.broadcast_time(now_ns)

    def _look(self, now_ns: int) -> None:
        """Collect the new subscribers and their topics."""
        for records in self._records:
            records.look()
        begun = set()
        while self._listeners.begun:
            begun.add(self._listeners.begun.popleft())
        for name in begun:
            self._scene.listens(name)
            for events in self._events:
                events.listens(name, self._stamps)
        self._scene.look(now_ns)

    def quit(self) -> None:
        """Disconnect all clients."""
        if hasattr(self, "_server"):
            self._server.stop()


def main() -> None:
    """Run it to its end."""
    runtime.run("foxglove", FoxgloveLoop)


if __name__ == "__main__":
    main()
