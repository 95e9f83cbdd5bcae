"""Topics and the robot in 3D for Foxglove and Lichtblick, over their WebSocket protocol. docs/foxglove.md.

It is read-only, and runs like a user's own process, at ordinary priority: a crash or hang has no effect on the system.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import TYPE_CHECKING

from trocar.procs.document.bridges import NO_FOXGLOVE
from trocar.procs.node.setup_error import LastingError
from trocar.procs.user.loop import live
from trocar.procs.user.process import UserNode

if TYPE_CHECKING:
    from trocar.procs.foxglove.server import TopicServer


class FoxgloveLoop(UserNode):
    """See above."""

    _server: TopicServer | None = None

    def setup(self) -> None:
        """Offer all topics; LastingError if the package is missing, RuntimeError if the address is taken."""
        row = self.own.document.foxglove
        if row is None:
            raise ValueError(f"{self.system} has no Foxglove server")
        if find_spec("foxglove") is None:
            raise LastingError(NO_FOXGLOVE)
        from trocar.procs.foxglove.server import TopicServer

        self._server = TopicServer(self.own, row)
        self.log.info("Foxglove: %s://%s", "wss" if row.certificate else "ws", row.listen)

    def update(self) -> None:
        """Publish the topics with subscribers."""
        if self._server is not None:
            self._server.step(self.time.now_ns())

    def quit(self) -> None:
        """Disconnect all clients."""
        if self._server is not None:
            self._server.close()


def main() -> None:
    """Run it to its end."""
    live("foxglove", FoxgloveLoop)


if __name__ == "__main__":
    main()
