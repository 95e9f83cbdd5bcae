"""The socket bridge: what is in shared memory for programs elsewhere, as JSON over TCP and WebSocket. docs/socket.md.

Between two cycles it serves its clients. Held up for 0.3 s it restarts, and all of them are disconnected: what they
asked meanwhile is about the past.
"""

from __future__ import annotations

import asyncio
from typing import Final

from procs import runtime
from procs.socket_bridge.server import SocketServer

SHOW_NS: Final = 1_000_000_000


class SocketLoop(runtime.Loop):
    """Serves clients; shows once a second what they do."""

    def __init__(self, node: runtime.Node) -> None:
        """Take the sockets; AccessError when the token or a certificate cannot be used."""
        super().__init__(node)
        self._state = node.writes("state")
        self._cells = {name: self._state.field(name) for name in
                       ("clients", "subscriptions", "received", "sent", "lost", "commands", "refused")}
        self._show_at = 0
        self._events = asyncio.new_event_loop()
        asyncio.set_event_loop(self._events)
        self._server = SocketServer(node.document, node.is_over, node.log)
        sockets = [listening.dup() for listening in node.listening]  # ours stay open for the loop after this one
        self._events.run_until_complete(self._server.listen(sockets))

    def wait(self) -> bool:
        """Serve until the next cycle."""
        return self.node.tick(self._serve)

    def _serve(self, left_ns: int) -> bool:
        self._events.call_later(left_ns * 1e-9, self._events.stop)
        self._events.run_forever()
        return True

    def cycle(self, now_ns: int, wall_ns: int) -> None:
        """Show what clients do."""
        if now_ns < self._show_at:
            return
        self._show_at, cells, counts = now_ns + SHOW_NS, self._cells, self._server.served.counts
        sessions = self._server.sessions
        cells["clients"][...] = len(sessions)
        cells["subscriptions"][...] = sum(len(session.streams) for session in sessions)
        cells["received"][...], cells["refused"][...] = counts.received, counts.refused
        cells["sent"][...], cells["lost"][...], cells["commands"][...] = counts.sent, counts.lost, counts.commands
        self._state.publish(now_ns)

    def close(self) -> None:
        """Disconnect everybody."""
        self._server.close()
        self._events.run_until_complete(asyncio.sleep(0))
        self._events.close()


def main() -> None:
    """Run it."""
    runtime.run("socket_bridge", SocketLoop)


if __name__ == "__main__":
    main()
