"""One client's connection: bytes in, messages to its session; messages to the client are sent as fast as it reads."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING, Final, cast

from trocar.procs.crtk.messages import said
from trocar.procs.socket_bridge.framing import Ended, Framing, framing_of

if TYPE_CHECKING:
    from trocar.procs.socket_bridge.server import SocketServer
    from trocar.procs.socket_bridge.session import Session

SLICE: Final = 16
"""Messages of one client, then it is the next one's turn."""
HIGH: Final = 1 << 18
"""Bytes that a client has not read: from here on it gets no records."""
LAST_S: Final = 5.0
"""Time in which a client that has closed its sending side still gets answers."""
LOOK_S: Final = 0.02
MOST: Final = 1 << 22
"""Bytes, then it is disconnected."""


class Connection(asyncio.Protocol):
    """A client that is connected."""

    def __init__(self, door: SocketServer, address: str) -> None:
        """`address`: the entry of `listen` to which it connected."""
        self.address = address
        self.on_end: Callable[[], None] = lambda: None
        self._door = door
        self._loop = asyncio.get_event_loop()
        self._transport: asyncio.Transport | None = None
        self._listener: Session | None = None
        self._framing: Framing | None = None
        self._begin = b""
        self._backlog: deque[bytes] = deque()
        self._out: list[bytes] = []
        self._is_paused = self._is_ended = self._is_early = False
        self._early = 0
        """Messages of the backlog that may have waited for the bridge's start."""

    @property
    def peer(self) -> tuple[str, int]:
        """Address and port of the client."""
        host, port, *_ = self._transport.get_extra_info("peername") if self._transport else ("", 0)
        return host, port

    @property
    def local_port(self) -> int:
        """The port to which it connected."""
        return int(self._transport.get_extra_info("sockname")[1]) if self._transport else 0

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        """A client has connected."""
        self._transport = cast(asyncio.Transport, transport)
        self._is_early = self._door.served.first.may_have_waited
        self._listener = self._door.admit(self)

    def data_received(self, data: bytes) -> None:
        """Bytes of any number of messages."""
        if self._door.served.is_over() or self._is_ended:
            return
        is_first = self._framing is None
        if self._framing is None:
            self._begin = data = self._begin + data
            self._framing = framing_of(data)
            if self._framing is None:
                return
        try:
            self._backlog += self._framing.feed(data)
        except Ended as error:
            self.end(str(error))
            return
        if is_first and self._is_early:
            self._early = len(self._backlog)
        self._pass(self._framing.waiting())
        self._work()

    def _work(self) -> None:
        for _ in range(min(SLICE, len(self._backlog))):
            if self._listener is None or self._is_ended or self._door.served.is_over():
                self._backlog.clear()
                return
            self._listener.handle(self._backlog.popleft(), has_waited=self._early > 0)
            self._early = max(0, self._early - 1)
        if self._transport is None or self._is_ended:
            return
        if bool(self._backlog) is not self._is_paused:
            self._is_paused = bool(self._backlog)
            (self._transport.pause_reading if self._is_paused else self._transport.resume_reading)()
        if self._backlog:
            self._loop.call_soon(self._work)

    def eof_received(self) -> bool:
        """The client sends no more, as with `echo … | nc`: answers under way are still sent, nothing else is."""
        if self._transport is None or self._transport.get_extra_info("sslcontext") is not None:
            return False
        self._finish(self._loop.time() + LAST_S)
        return True

    def _finish(self, until_s: float) -> None:
        is_waiting = self._backlog or (self._listener is not None and self._listener.is_waiting)
        if is_waiting and self._loop.time() < until_s and self._transport is not None and not self._is_ended:
            self._loop.call_later(LOOK_S, self._finish, until_s)
        else:
            self.end()

    @property
    def is_slow(self) -> bool:
        """Whether the client does not read its data."""
        return self._transport is None or self._transport.get_write_buffer_size() > HIGH

    def send(self, message: bytes) -> None:
        """Send it a message; messages of one turn of the loop are sent together."""
        if self._framing is not None and not self._is_ended:
            self._pass(self._framing.frame(message))

    def _pass(self, data: bytes) -> None:
        if data:
            self._out.append(data)
            if len(self._out) == 1:
                self._loop.call_soon(self._flush)

    def _flush(self) -> None:
        out, self._out = b"".join(self._out), []
        if self._transport is None or not out:
            return
        self._transport.write(out)
        if self._transport.get_write_buffer_size() > MOST:
            self._transport.abort()  # the client sends requests but does not read the answers

    def end(self, why: str = "") -> None:
        """Disconnect it, with the reason."""
        if self._is_ended or self._transport is None:
            return
        if why:
            if self._framing is None:
                self._pass(said("error", error=why) + b"\n")
            else:
                self.send(said("error", error=why))
        if self._framing is not None:
            self._pass(self._framing.waiting())
        self._is_ended = True
        self._backlog.clear()
        self._flush()
        self._transport.close()
        self._loop.call_later(5.0, self._transport.abort)

    def connection_lost(self, error: Exception | None) -> None:
        """It has gone, or we have."""
        self._is_ended, self._transport = True, None
        if self._listener is not None:
            self._listener.gone()
            self._listener = None
            self.on_end()
