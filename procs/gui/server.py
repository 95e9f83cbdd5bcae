"""The web server: pages, and the connection that each page has for its data and its commands."""

from __future__ import annotations

import asyncio
import logging
import socket
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext, suppress
from typing import Final

import uvicorn
from fastapi import FastAPI, WebSocket, WebSocketDisconnect

from trocar.procs.document.bridges import WebConsole
from trocar.procs.gui.browsers import Browsers
from trocar.procs.gui.gate import Gate
from trocar.procs.machine.access import tls_of

BYTES: Final = 1 << 20
"""Of a message, of those that NiceGUI sends as well."""
STEP_S: Final = 0.01


class _Server(uvicorn.Server):
    """One that leaves signals to the process."""

    def capture_signals(self) -> AbstractContextManager[None]:  # type: ignore[override]
        return nullcontext()


class WebServer:
    """It serves the pages of an application, and `/live` for them, to clients that the gate admits."""

    def __init__(self, pages: FastAPI, console: WebConsole, token: bytes, browsers: Browsers,
                 log: logging.Logger) -> None:
        """AccessError when a certificate cannot be used."""
        self._browsers, self._most = browsers, console.max_clients
        tls = tls_of(console)
        pages.add_api_websocket_route("/live", self._live)
        pages.router.routes.insert(0, pages.router.routes.pop())  # before the pages, which are mounted at /
        gate = Gate(pages, token, bool(console.authorities), log)
        self._server = _Server(uvicorn.Config(
            gate, log_config=None, access_log=False, proxy_headers=False, server_header=False, loop="none", http="h11",
            ws="websockets-sansio", ws_max_size=BYTES, lifespan="on", timeout_graceful_shutdown=1,
            ssl_context_factory=(lambda config, make: tls) if tls is not None else None))
        self._task: asyncio.Task[None] | None = None

    async def listen(self, sockets: Sequence[socket.socket]) -> None:
        """Serve clients at these sockets; returns when listening."""
        self._task = asyncio.create_task(self._server.serve(list(sockets)))
        while not self._server.started:
            if self._task.done():
                self._task.result()
                raise RuntimeError("the web server has ended")
            await asyncio.sleep(STEP_S)

    async def _live(self, page: WebSocket) -> None:
        """The connection of one page."""
        await page.accept()
        client = page.client
        if client is None or len(self._browsers.all) >= self._most:
            await page.close(1013, f"{len(self._browsers.all)} pages are open already (trocar.gui.max_clients): "
                                   "close one; until then nothing works here, not even Power off")
            return
        browser = self._browsers.come(page, f"{client.host} port {client.port}")
        sending = asyncio.create_task(browser.deliver())
        try:
            with suppress(WebSocketDisconnect, RuntimeError):  # also where we have closed it
                await browser.listen(page.receive_text)
        finally:
            sending.cancel()
            self._browsers.leave(browser)

    async def close(self) -> None:
        """Disconnect all browsers."""
        self._server.should_exit = True
        if self._task is not None:
            with suppress(Exception):
                await self._task
