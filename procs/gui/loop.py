"""The web console: the robot in a browser. docs/gui.md.

Between two cycles it serves browsers: pages, and the connection `/live` that each page has for its data and commands.
Once a cycle it sends each page its data. After a stall of `late_s` it disconnects all: their requests from the stall
are out of date.
"""

from __future__ import annotations

import asyncio
import os
import socket
from contextlib import AbstractContextManager, nullcontext, suppress
from functools import partial
from typing import Any, Final

import uvicorn
from starlette.websockets import WebSocket, WebSocketDisconnect

from trocar.procs.crtk.calls import owners_of
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.browsers import Browsers, ConsoleService
from trocar.procs.gui.catalogue import sources_of
from trocar.procs.gui.fault_files import recordings_of
from trocar.procs.gui.gate import Gate
from trocar.procs.gui.pages.application import application, name_of, texts_of_pages
from trocar.procs.gui.pages.strip import ends
from trocar.procs.gui.past import Past
from trocar.procs.gui.scene_source import ArmModels
from trocar.procs.gui.timeline_source import TimelineSource
from trocar.procs.machine.access import tls_of, token_in
from trocar.procs.machine.paths import token_file
from trocar.procs.node import runtime
from trocar.procs.node.pacing import duration
from trocar.procs.node.serving import ServingLoop
from trocar.shm.system import directory

BYTES: Final = 1 << 20
"""Of a message."""
STEP_S: Final = 0.01


class _Server(uvicorn.Server):
    """One that leaves signals to the process."""

    def capture_signals(self) -> AbstractContextManager[None]:  # type: ignore[override]
        return nullcontext()


class GuiLoop(ServingLoop):
    """Serves pages."""

    async def listen(self, sockets: list[socket.socket]) -> None:
        """See ServingLoop; clients pass the gate first."""
        node, document, console = self.node, self.node.document, self.node.document.gui
        if console is None:
            raise ValueError("the system has no web console")
        self._most, texts = console.max_clients, texts_of_pages(document)
        past = node.hold(Past(document, recordings_of(document), directory.document(document.name)))
        sources = node.hold(sources_of(document, partial(TimelineSource, document, past)))
        models = node.hold(ArmModels(document))
        self._browsers = node.hold(Browsers(ConsoleService(
            document.name, owners_of(document), sources, node.pauses.is_over, models, name_of(texts),
            node.faults().generation, ends(document), past)))
        token, tls = token_in(console.token_file or _made_token(document)), tls_of(console)
        pages = application(document, texts, self._live, node.log)
        self._server = _Server(uvicorn.Config(
            Gate(pages, token, bool(console.authorities), node.log), log_config=None, access_log=False,
            proxy_headers=False, server_header=False, loop="none", http="h11", ws="websockets-sansio",
            ws_max_size=BYTES, lifespan="off", timeout_graceful_shutdown=1,
            ssl_context_factory=(lambda config, make: tls) if tls is not None else None))
        self._task = asyncio.create_task(self._server.serve(sockets))
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
        browser = self._browsers.come(page, f"{client.host} port {client.port}", page.query_params.get("run", ""))
        sending = asyncio.create_task(browser.deliver())
        try:
            with suppress(WebSocketDisconnect, RuntimeError):  # also where we have closed it
                await browser.listen(page.receive_text)
        finally:
            sending.cancel()
            self._browsers.leave(browser)

    def update(self) -> None:
        """Send the pages' data, publish their activity."""
        node = self.node
        if node.held_up_ns:
            self._browsers.forget(f"the web console stalled for {duration(node.held_up_ns)}")
            node.pauses.begin()
        self._browsers.tick(node.now_ns)
        super().update()

    def shown(self, now_ns: int) -> dict[str, Any]:
        """Activity of the pages."""
        browsers, counts = self._browsers.all, self._browsers.served.counts
        holder = self._browsers.served.control.holder(now_ns)
        return {"browsers": len(browsers), "watching": sum(bool(browser.wants) for browser in browsers),
                "controlling": self._browsers.person(holder).encode()[:40], "sent": counts.sent,
                "lost": counts.lost, "commands": counts.commands, "refused": counts.refused}

    async def disconnect(self) -> None:
        """See ServingLoop."""
        self._server.should_exit = True
        with suppress(Exception):
            await self._task
        self.node.pauses.end()  # no page can send now; what they hold is released, however long that took


def _made_token(document: SystemConfig) -> str:
    """The file of the token that was made at start; empty: none was."""
    is_made = document.gui is not None and document.gui.makes_token
    return str(token_file(os.environ, document.name)) if is_made else ""


def main() -> None:
    """Run it."""
    runtime.run("gui", GuiLoop)


if __name__ == "__main__":
    main()
