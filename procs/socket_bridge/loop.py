"""The socket bridge: shared memory for programs on other machines, as JSON over TCP and WebSocket. docs/socket.md.

Between two cycles it serves its clients. After a stall of 0.3 s it restarts, and all clients are disconnected: their
requests from the stall are out of date.
"""

from __future__ import annotations

import socket
from typing import Any

from trocar.procs.crtk.last_look import FirstMessages
from trocar.procs.node import runtime
from trocar.procs.node.serving import ServingLoop
from trocar.procs.socket_bridge.server import SocketServer


class SocketLoop(ServingLoop):
    """Serves clients."""

    async def listen(self, sockets: list[socket.socket]) -> None:
        """See ServingLoop."""
        node = self.node
        self._server = SocketServer(node.document, node.pauses.is_over, node.log,
                                    FirstMessages(node.faults().generation))
        await self._server.listen(sockets)

    async def disconnect(self) -> None:
        """See ServingLoop."""
        self.node.pauses.end()  # clients are not heard from here on; what they hold is released, also after a stall
        await self._server.close()

    def shown(self, now_ns: int) -> dict[str, Any]:
        """The clients' activity."""
        sessions, counts = self._server.sessions, self._server.served.counts
        return {"clients": len(sessions), "subscriptions": sum(len(session.streams) for session in sessions),
                "received": counts.received, "refused": counts.refused, "sent": counts.sent, "lost": counts.lost,
                "commands": counts.commands}


def main() -> None:
    """Run it."""
    runtime.run("socket_bridge", SocketLoop)


if __name__ == "__main__":
    main()
