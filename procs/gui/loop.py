"""The web console: the robot in a browser. docs/gui.md.

Between two cycles it serves browsers, once a cycle it sends to each page what it wants. Held up for a second it
disconnects all: what they asked meanwhile is about the past.
"""

from __future__ import annotations

import asyncio
import os
from typing import Final

from procs import runtime
from procs.access import token_in
from procs.crtk.calls import owners_of
from procs.document.system import SystemConfig
from procs.gui.browsers import Browsers, ConsoleService
from procs.gui.catalogue import sources_of
from procs.gui.pages.application import application
from procs.gui.scene_source import ArmModels
from procs.gui.server import WebServer
from procs.paths import token_file
from procs.pauses import Pauses, duration
from shm.clock import monotonic_ns

SHOW_NS: Final = 1_000_000_000
HELD_UP_NS: Final = 1_000_000_000


class GuiLoop(runtime.Loop):
    """Serves pages; shows once a second what they do."""

    def __init__(self, node: runtime.Node) -> None:
        """Take the sockets; AccessError when the token or a certificate cannot be used."""
        super().__init__(node)
        document = node.document
        if document.gui is None:
            raise ValueError("the system has no web console")
        self._state = node.writes("state")
        self._cells = {name: self._state.field(name) for name in
                       ("browsers", "watching", "controlling", "sent", "lost", "commands", "refused")}
        self._show_at, self._period_ns = 0, round(node.row.period_s * 1e9)
        self._pauses = Pauses(HELD_UP_NS)
        self._events = asyncio.new_event_loop()
        asyncio.set_event_loop(self._events)
        run = f"{os.getpid()}-{monotonic_ns()}"
        self._sources, self._models = sources_of(document), ArmModels(document)
        self._browsers = Browsers(ConsoleService(document.name, owners_of(document), self._sources,
                                                 self._pauses.is_over, self._models, run))
        token = token_in(document.gui.token_file or _made_token(document))
        self._server = WebServer(application(document), document.gui, token, self._browsers, node.log)
        sockets = [listening.dup() for listening in node.listening]  # the server closes those it is given
        self._events.run_until_complete(self._server.listen(sockets))

    def wait(self) -> bool:
        """Serve until the next cycle."""
        return self.node.tick(self._serve)

    def _serve(self, left_ns: int) -> bool:
        self._events.call_later(left_ns * 1e-9, self._events.stop)
        self._events.run_forever()
        return True

    def cycle(self, now_ns: int, wall_ns: int) -> None:
        """Send what pages want, show what they do."""
        if late_ns := self._pauses.next(self._period_ns):
            self._browsers.forget(f"the web console was held up for {duration(late_ns)}")
            self._pauses.begin()
        self._browsers.tick(now_ns)
        if now_ns < self._show_at:
            return
        self._show_at, cells, counts = now_ns + SHOW_NS, self._cells, self._browsers.served.counts
        cells["browsers"][...] = len(self._browsers.all)
        cells["watching"][...] = sum(bool(browser.wants) for browser in self._browsers.all)
        cells["controlling"][...] = self._browsers.served.control.holder(now_ns).encode()[:40]
        cells["sent"][...], cells["lost"][...] = counts.sent, counts.lost
        cells["commands"][...], cells["refused"][...] = counts.commands, counts.refused
        self._state.publish(now_ns)

    def close(self) -> None:
        """Disconnect everybody."""
        self._events.run_until_complete(self._server.close())
        self._sources.close()
        self._models.close()
        self._events.close()


def _made_token(document: SystemConfig) -> str:
    """The file of the token that was made at start; empty: none was."""
    is_made = document.gui is not None and document.gui.makes_token
    return str(token_file(os.environ, document.name)) if is_made else ""


def main() -> None:
    """Run it."""
    runtime.run("gui", GuiLoop)


if __name__ == "__main__":
    main()
