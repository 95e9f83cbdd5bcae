"""All clients: accepts them, and sends due data."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

from trocar.procs.crtk.calls import owners_of
from trocar.procs.crtk.last_look import FirstMessages
from trocar.procs.document.system import SystemConfig
from trocar.procs.machine.access import is_ours, tls_of, token_in
from trocar.procs.socket_bridge.connection import Connection
from trocar.procs.socket_bridge.session import ClientService, Session
from trocar.procs.socket_bridge.topics import Topics
from trocar.shm.time.clock import monotonic_ns

HELLO_S: Final = 10.0
"""In which a client has to show its token."""
QUICKEST_S: Final = 0.001


class SocketServer:
    """One system's bridge, in the caller's event loop."""

    def __init__(self, document: SystemConfig, is_over: Callable[[], bool], log: logging.Logger, first: FirstMessages
                 ) -> None:
        """AccessError when its token or certificate cannot be used. `is_over`: see `Admission`."""
        if document.socket is None:
            raise ValueError("the system has no socket bridge")
        self._bridge, self._log, self._loop = document.socket, log, asyncio.get_event_loop()
        self._tls = tls_of(self._bridge)
        self.served = ClientService(document.name, document.clock, token_in(self._bridge.token_file),
                                    Topics(document.name), instances_of(document), owners_of(document), is_over,
                                    first, self._wake)
        self.sessions: set[Session] = set()
        self._servers: list[asyncio.Server] = []
        self._timer: asyncio.TimerHandle | None = None
        self._at, self._turn = 0.0, 0

    async def listen(self, sockets: Sequence[socket.socket]) -> None:
        """Accept clients at these addresses, one for each address of the bridge."""
        for address, listening in zip(self._bridge.listen, sockets, strict=True):
            made = partial(Connection, self, address)
            self._servers.append(await self._loop.create_server(
                made, sock=listening, ssl=self._tls, ssl_handshake_timeout=HELLO_S if self._tls else None))

    def admit(self, connection: Connection) -> Session | None:
        """A session for a client, or the end of its connection."""
        host, port = connection.peer
        if len(self.sessions) >= self._bridge.max_clients:
            connection.end(f"{len(self.sessions)} clients are connected already (trocar.socket.max_clients)")
            return None
        rights = self._bridge.rights_at(connection.address)
        is_known = bool(self._bridge.authorities) or (rights.local and is_ours((host, port), connection.local_port))
        if not is_known and not self.served.token:
            self._log.warning("%s port %s: a program of another user, and there is no token", host, port)
            connection.end("programs of other users need a token (trocar.socket.token_file)")
            return None
        session = Session(self.served, connection, rights, is_known)
        self.sessions.add(session)
        connection.on_end = partial(self._left, session, f"{host} port {port}")
        if not is_known:
            self._loop.call_later(HELLO_S, self._expect_hello, session)
        self._log.info("%s port %s has connected; clients: %d", host, port, len(self.sessions))
        return session

    def _expect_hello(self, session: Session) -> None:
        if session in self.sessions and not session.is_known:
            session.link.end("no token was received")

    def _left(self, session: Session, who: str) -> None:
        self.sessions.discard(session)
        self._log.info("%s has disconnected; clients: %d", who, len(self.sessions))

    def _wake(self) -> None:
        """A client has sent a request: look soon."""
        self._look_in(QUICKEST_S)

    def _look_in(self, seconds: float) -> None:
        at = self._loop.time() + max(seconds, QUICKEST_S)
        if self._timer is None or at < self._at:
            if self._timer is not None:
                self._timer.cancel()
            self._at, self._timer = at, self._loop.call_at(at, self._serve)

    def _serve(self) -> None:
        self._timer = None
        self._turn += 1
        now_ns, next_s = monotonic_ns(), float("inf")
        for session in tuple(self.sessions):
            try:
                next_s = min(next_s, session.serve(now_ns, self._turn))
            except Exception:  # of one client: the others are served on
                self._log.exception("a client cannot be served")
                session.link.end("the bridge cannot serve this; its log says why")
        if next_s < float("inf"):
            self._look_in(next_s)

    async def close(self) -> None:
        """Disconnect all clients, and release everything."""
        if self._timer is not None:
            self._timer.cancel()
        for server in self._servers:
            server.close()
        for session in tuple(self.sessions):
            session.link.end()
            session.gone()
        self.served.topics.close()
        await asyncio.sleep(0)  # the connections end


def instances_of(document: SystemConfig) -> dict[str, str]:
    """Type of each instance: that of the arm, else the kind of its process."""
    types = {arm.name: arm.type for arm in document.arms}
    return {row.name: types.get(row.name, row.kind) for row in document.processes}
