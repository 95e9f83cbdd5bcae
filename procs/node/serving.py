"""Loops that serve sockets by asyncio between cycles, and publish their state once a second."""

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

    def __init__(self, node: runtime.Node) -> None:
        super().__init__(node)
        self._state, self._show_at = node.writes("state"), 0
        self.events = asyncio.new_event_loop()
        asyncio.set_event_loop(self.events)

    def sockets(self) -> list[socket.socket]:
        """Duplicates of the listening sockets, for a server that closes them: ours remain for the next loop."""
        return [listening.dup() for listening in self.node.listening]

    def wait(self) -> bool:
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
