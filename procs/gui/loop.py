"""The web console: the robot in a browser. docs/gui.md.

Between two cycles it serves browsers; once a cycle it sends each page its data. After a stall of one second it
disconnects all: their requests from the stall are out of date.
"""

from __future__ import annotations

import os
from typing import Any, Final

from trocar.procs.crtk.calls import owners_of
from trocar.procs.document.system import SystemConfig
from trocar.procs.gui.browsers import Browsers, ConsoleService
from trocar.procs.gui.catalogue import sources_of
from trocar.procs.gui.pages.application import application
from trocar.procs.gui.scene_source import ArmModels
from trocar.procs.gui.server import WebServer
from trocar.procs.machine.access import token_in
from trocar.procs.machine.paths import token_file
from trocar.procs.node import runtime
from trocar.procs.node.pacing import Pauses, duration
from trocar.procs.node.serving import ServingLoop
from trocar.shm.mailbox.generations import Faults
from trocar.shm.time.clock import monotonic_ns

HELD_UP_NS: Final = 1_000_000_000


class GuiLoop(ServingLoop):
    """Serves pages."""

    def __init__(self, node: runtime.Node) -> None:
        """Take the sockets; AccessError when the token or a certificate cannot be used."""
        super().__init__(node)
        document = node.document
        if document.gui is None:
            raise ValueError("the system has no web console")
        self._period_ns, self._pauses = round(node.row.period_s * 1e9), Pauses(HELD_UP_NS)
        run = f"{os.getpid()}-{monotonic_ns()}"
        self._sources, self._models, self._faults = sources_of(document), ArmModels(document), Faults(document.name)
        self._browsers = Browsers(ConsoleService(document.name, owners_of(document), self._sources,
                                                 self._pauses.is_over, self._models, run,
                                                 self._faults.generation))
        token = token_in(document.gui.token_file or _made_token(document))
        self._server = WebServer(application(document), document.gui, token, self._browsers, node.log)
        self.events.run_until_complete(self._server.listen(self.sockets()))

    def cycle(self, now_ns: int, wall_ns: int) -> None:
        """Send the pages' data, publish their activity."""
        if late_ns := self._pauses.next(self._period_ns):
            self._browsers.forget(f"the web console stalled for {duration(late_ns)}")
            self._pauses.begin()
        self._browsers.tick(now_ns)
        self.show(now_ns)

    def shown(self, now_ns: int) -> dict[str, Any]:
        """Activity of the pages."""
        browsers, counts = self._browsers.all, self._browsers.served.counts
        return {"browsers": len(browsers), "watching": sum(bool(browser.wants) for browser in browsers),
                "controlling": self._browsers.served.control.holder(now_ns).encode()[:40], "sent": counts.sent,
                "lost": counts.lost, "commands": counts.commands, "refused": counts.refused}

    def close(self) -> None:
        """Disconnect all browsers."""
        self.events.run_until_complete(self._server.close())
        self._browsers.close()
        self._sources.close()
        self._models.close()
        self._faults.close()
        self.events.close()


def _made_token(document: SystemConfig) -> str:
    """The file of the token that was made at start; empty: none was."""
    is_made = document.gui is not None and document.gui.makes_token
    return str(token_file(os.environ, document.name)) if is_made else ""


def main() -> None:
    """Run it."""
    runtime.run("gui", GuiLoop)


if __name__ == "__main__":
    main()
