"""The socket bridge: shared memory for programs on other machines, as JSON over TCP and WebSocket. docs/socket.md.

Between two cycles it serves its clients. After a stall of 0.3 s it restarts, and all clients are disconnected: their
requests from the stall are out of date.
"""

from __future__ import annotations

import asyncio
from typing import Any

from trocar.procs.crtk.last_look import FirstMessages
from trocar.procs.node import runtime
from trocar.procs.node.serving import ServingLoop
from trocar.procs.socket_bridge.server import SocketServer
from trocar.shm.mailbox.generations import Faults


class SocketLoop(ServingLoop):
    """Serves clients."""

    def __init__(self, node: runtime.Node) -> None:
        """Take the sockets; AccessError when the token or a certificate cannot be used."""
        super().__init__(node)
        first = FirstMessages(node.hold(Faults(node.document.name)).generation)
        self._server = SocketServer(node.document, node.is_over, node.log, first)
        self.events.run_until_complete(self._server.listen(self.sockets()))

    def cycle(self, now_ns: int, wall_ns: int) -> None:
        """Publish the clients' activity."""
        self.show(now_ns)

    def shown(self, now_ns: int) -> dict[str, Any]:
        """The clients' activity."""
        sessions, counts = self._server.sessions, self._server.served.counts
        return {"clients": len(sessions), "subscriptions": sum(len(session.streams) for session in sessions),
                "received": counts.received, "refused": counts.refused, "sent": counts.sent, "lost": counts.lost,
                "commands": counts.commands}

    def close(self) -> None:
        """Disconnect everybody."""
        self._server.close()
        self.events.run_until_complete(asyncio.sleep(0))
        self.events.close()


def main() -> None:
    """Run it."""
    runtime.run("socket_bridge", SocketLoop)


if __name__ == "__main__":
    main()
