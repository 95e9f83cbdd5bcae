"""Address of a system's web console."""

from __future__ import annotations

import contextlib
import os
import socket

from trocar.procs.document.system import from_json
from trocar.procs.machine.paths import token_file
from trocar.shm.system import directory


def web_addresses(system: str) -> list[str]:
    """Addresses in a running system, with the token if one was made at its start; none without a console."""
    gui, token = from_json(directory.document(system)).gui, ""
    if gui is None:
        return []
    if gui.makes_token:
        with contextlib.suppress(OSError):  # another user's file: its owner has the token
            token = token_file(os.environ, system).read_text().strip()
    return gui.links(token, socket.gethostname())
