"""Loops that serve clients by asyncio between cycles, and publish their state once a second.

After a stall the clients are disconnected, because their requests from the stall are out of date.
"""

from __future__ import annotations

import asyncio
import socket
from abc import abstractmethod
from collections.abc import Mapping
from typing import Any, Final

from trocar.procs.node import runtime

SHOW_NS: Final = 1_000_000_000


class ServingLoop(runtime.Loop):
    """A loop whose asyncio `events` run between cycles; `shown` fills its record `state`."""

    _listens = False

    def setup(self) -> None:
        """Begin to serve clients; AccessError when the token or a certificate cannot be used."""
        self._state, self._show_at = self.node.writes("state"), 0
        self.events = self.node.hold(asyncio.new_event_loop())
        asyncio.set_event_loop(self.events)
        # duplicates, because servers close them: ours remain for the next loop
        self.events.run_until_complete(self.listen([each.dup() for each in self.node.listening]))
        self._listens = True

    @abstractmethod
    async def listen(self, sockets: list[socket.socket]) -> None:
        """Accept clients at these sockets."""

    @abstractmethod
    async def disconnect(self) -> None:
        """Disconnect all clients, and close the sockets."""

    def update(self) -> None:
        """Publish the clients' activity."""
        self.show(self.node.now_ns)

    def quit(self) -> None:
        """Disconnect all clients."""
        if self._listens:
            self.events.run_until_complete(self.disconnect())

    def tick(self) -> bool:
        """Serve until the next cycle."""
        return self.node.tick(self._serve)

    def _serve(self, left_ns: int) -> bool:
        self.events.call_later(left_ns * 1e-9, self.events.stop)
        self.events.run_forever()
        return True

    def show(self, now_ns: int) -> None:
        """Publish the record `state`, once a second."""
        if now_ns < self._show_at:
            return
        self._show_at = now_ns + SHOW_NS
        for name, value in self.shown(now_ns).items():
            self._state.field(name)[...] = value
        self._state.publish(max(self.node.stamp_ns(), self._state.stamp_ns + 1))

    @abstractmethod
    def shown(self, now_ns: int) -> Mapping[str, Any]:
        """Fields of its record `state`."""
